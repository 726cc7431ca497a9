"""How each place stood at each instant, by what robots said of it."""

from typing import NamedTuple

from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.places import PlaceState, draw_places
from actors.task.words import PlaceKey
from deploy.view.story import Story


class _Word(NamedTuple):
    """Something that a robot said."""

    second: float
    robot: str
    what: str
    """route, done or given_up."""
    places: tuple[PlaceKey, ...]


def draw_place_history(canvas: Canvas, story: Story) -> None:
    """Draw the places of each owner whenever one of them stands otherwise."""
    states = {
        PlaceKey(owner, number): PlaceState(x, y, holders=(owner,))
        for owner, places in story.places.items()
        for number, (x, y) in enumerate(places)
    }
    to_come = {key for key in states if key.place >= story.begun_with[key.owner]}
    held = {
        owner: frozenset(key for key in states.keys() - to_come if key.owner == owner)
        for owner in story.places
    }
    shown = {key: state for key, state in states.items() if key not in to_come}
    _draw(canvas, 0.0, shown, set(story.places))
    for word in _words(story):
        touched = set(word.places)
        if word.what == "route":
            now = frozenset(word.places)
            touched = set(now ^ held.get(word.robot, frozenset()))
            held[word.robot] = now
        changed = set()
        for key in touched & states.keys():
            new = _after(states[key], key, word.what, held, story.robots)
            if new != shown.get(key):
                states[key] = shown[key] = new
                changed.add(key.owner)
        _draw(canvas, word.second, shown, changed)


def _after(
    state: PlaceState, key: PlaceKey, what: str, held: dict[str, frozenset[PlaceKey]], robots: tuple[str, ...]
) -> PlaceState:
    """How a place stands once something was said of it."""
    if what == "route":
        return state._replace(holders=tuple(robot for robot in robots if key in held.get(robot, ())))
    return state._replace(done=True) if what == "done" else state._replace(given_up=True)


def _words(story: Story) -> list[_Word]:
    """In order of time; at one instant what has become of a place comes before who holds it."""
    said = [_Word(deed.second, deed.robot, "done", (deed.place,)) for deed in story.reported]
    said += [_Word(deed.second, deed.robot, "given_up", (deed.place,)) for deed in story.given_up]
    said += [_Word(route.second, route.robot, "route", route.places) for route in story.routes]
    return sorted(said, key=lambda word: (word.second, word.what))


def _draw(canvas: Canvas, second: float, states: dict[PlaceKey, PlaceState], owners: set[str]) -> None:
    for owner in sorted(owners):
        mine = [state for key, state in states.items() if key.owner == owner]
        if mine:
            draw_places(canvas, owner, second, mine)
