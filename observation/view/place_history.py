"""How each place stood at each instant, by what robots said of it."""

from typing import NamedTuple

from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.places import PlaceState, draw_places
from actors.task.words import PlaceKey
from observation.view.story import Story


class _RobotWord(NamedTuple):
    """Something that a robot said."""

    second: float
    robot: str
    what: str
    """route, done or given_up."""
    places: tuple[PlaceKey, ...]


class PlaceHistory:
    """Draws the places of each owner whenever one of them stands otherwise."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._states: dict[PlaceKey, PlaceState] = {}
        self._shown: dict[PlaceKey, PlaceState] = {}
        """Those that somebody has spoken of, and those that were there from the beginning."""
        self._held: dict[str, frozenset[PlaceKey]] = {}

    def extend(self, story: Story) -> None:
        """Take in a story, or its next piece."""
        self._come(story)
        for word in _words(story):
            touched = set(word.places)
            if word.what == "route":
                now = frozenset(word.places)
                touched = set(now ^ self._held.get(word.robot, frozenset()))
                self._held[word.robot] = now
            changed = set()
            for key in touched & self._states.keys():
                new = self._after(key, word.what)
                if new != self._shown.get(key):
                    self._states[key] = self._shown[key] = new
                    changed.add(key.owner)
            self._draw(word.second, changed)

    def _come(self, story: Story) -> None:
        """The places that are new: shown at once if they are of the beginning, else once spoken of."""
        owners = set()
        for owner, places in story.places.items():
            for number, (x, y) in enumerate(places):
                key = PlaceKey(owner, number)
                if key in self._states:
                    continue
                self._states[key] = PlaceState(x, y, holders=(owner,))
                if number < story.begun_with[owner]:
                    self._shown[key] = self._states[key]
                    self._held[owner] = self._held.get(owner, frozenset()) | {key}
                    owners.add(owner)
        self._draw(0.0, owners)

    def _after(self, key: PlaceKey, what: str) -> PlaceState:
        """How a place stands once something was said of it."""
        state = self._states[key]
        if what == "route":
            robots = self._canvas.robots
            return state._replace(
                holders=tuple(robot for robot in robots if key in self._held.get(robot, ()))
            )
        return state._replace(done=True) if what == "done" else state._replace(given_up=True)

    def _draw(self, second: float, owners: set[str]) -> None:
        for owner in sorted(owners):
            mine = [state for key, state in self._shown.items() if key.owner == owner]
            if mine:
                draw_places(self._canvas, owner, second, mine)


def _words(story: Story) -> list[_RobotWord]:
    """In order of time; at one instant what has become of a place comes before who holds it."""
    said = [_RobotWord(deed.second, deed.robot, "done", (deed.place,)) for deed in story.reported]
    said += [_RobotWord(deed.second, deed.robot, "given_up", (deed.place,)) for deed in story.given_up]
    said += [_RobotWord(route.second, route.robot, "route", route.places) for route in story.routes]
    return sorted(said, key=lambda word: (word.second, word.what))
