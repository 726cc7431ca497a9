"""A scenario written as text reads back as the same scenario, and so gives the same run."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as some

from actors.floor.placement import Area
from actors.instant import seconds
from actors.robot.behaviour.adaptation import Adaptation
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.stack_tables import adaptation
from deploy.scenario.tables import Scenario, to_toml
from tests.scenario.faults import scenario

texts = some.text(some.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=8)
finite = some.floats(allow_nan=False, allow_infinity=False)
coordinates = some.floats(-1e5, 1e5, allow_nan=False)
points = some.tuples(coordinates, coordinates)
poses = some.tuples(coordinates, coordinates, coordinates)


def maybe(value: some.SearchStrategy[Any]) -> some.SearchStrategy[Any]:
    return some.none() | value


def tables(**fields: some.SearchStrategy[Any]) -> some.SearchStrategy[dict[str, Any]]:
    """A table in which what may be absent is absent or there."""
    filled = some.fixed_dictionaries(fields)
    return filled.map(lambda table: {name: value for name, value in table.items() if value is not None})


def _id(table: Any) -> str:
    return str(table["id"])


NAMES = ["hall", 'the "lab"', "C:\\"]
names = some.lists(some.sampled_from(NAMES), min_size=1, unique=True)
spans = some.tuples(coordinates, coordinates).map(sorted).filter(lambda span: span[0] < span[1])
scenarios = some.fixed_dictionaries(
    {
        "map": some.from_regex(r"/[a-z\"\\\x7f]{1,9}", fullmatch=True),
        "run": tables(
            duration=some.floats(1.0, 1e6),
            step_ms=some.integers(1, 10).map(lambda n: 10 * n),
            strategy=texts,
            modules=some.just("/a/b"),
        ),
        "strategy": some.dictionaries(
            some.text(some.characters(codec="utf-8"), max_size=8),
            some.booleans() | some.integers(-(2**63), 2**63 - 1) | finite | texts,
            max_size=4,
        ),
        "deeco": tables(
            publish=some.floats(0.001, 1e6),
            relay=some.booleans(),
            hop_limit=some.integers(1, 15),
            relay_below=some.floats(-90, 0),
        ),
        "robots": tables(
            count=some.just(3),
            model=some.just("x"),
            sensor=maybe(texts),
            start=some.lists(poses, max_size=3),
            areas=maybe(names),
        ),
        "places": tables(preset=maybe(some.sampled_from(["areas", "golden"])), areas=maybe(names)),
        "area": some.tuples(*(tables(name=some.just(name), x=spans, y=spans) for name in NAMES)),
        "robot": some.lists(
            tables(
                id=some.sampled_from(["r1", "r2", "r3"]),
                odometry=maybe(some.just("kobuki")),
                start=maybe(poses),
                places=maybe(some.lists(points, max_size=3)),
            ),
            max_size=3,
            unique_by=_id,
        ),
        "event": some.lists(
            some.one_of(
                tables(at=some.floats(0.0, 0.5), obstacle=points, radius=some.floats(0.001, 10)),
                tables(at=some.floats(0.0, 0.5), close=points),
                tables(
                    at=some.floats(0.0, 0.5),
                    give=some.sampled_from(["r1", "r3"]),
                    places=some.lists(points, min_size=1, max_size=3),
                ),
            ),
            max_size=3,
        ),
    }
)


@given(scenarios)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_every_scenario_reads_back_as_it_was_written(content: dict[str, Any]) -> None:
    written = Scenario.model_validate(_as_lists(content))
    assert parse(to_toml(written), Path("/some.toml")) == written
    told = adaptation(written.strategy, written.deeco, written.area)
    assert told.settings == written.strategy
    assert {name: type(value) for name, value in told.settings.items()} == {
        name: type(value) for name, value in written.strategy.items()
    }
    assert told.exchange.publish == seconds(written.deeco.publish)
    assert told.exchange.relay is written.deeco.relay
    assert [area.name for area in told.areas] == NAMES


def test_what_a_run_writes_down_gives_the_same_run() -> None:
    first = resolve(load_scenario(None, Overrides(robots=11, seed=7)))
    written = to_toml(first.scenario)
    second = resolve(parse(written, Path("/elsewhere/scenario.toml")))
    found = asdict(second)
    assert found == asdict(first) | {name: found[name] for name in ("scenario", "grid")}
    assert second.grid.content == first.grid.content
    assert second.scenario == first.scenario
    assert to_toml(second.scenario) == written


def test_robots_are_told_the_areas_of_their_places_alone() -> None:
    text = "[strategy]\nlease = 3\n[places]\nareas = ['hall']\n"
    text += "".join(
        f"[[area]]\nname = '{name}'\nx = [8, 12]\ny = [10.5, 13.8]\n" for name in ("yard", "hall")
    )
    settled = resolve(scenario(text))
    assert settled.adaptation == Adaptation({"lease": 3}, areas=(Area("hall", 8.0, 10.5, 12.0, 13.8),))
    assert resolve(settled.scenario).adaptation == settled.adaptation
    free = resolve(scenario(text.replace("areas = ['hall']", "preset = 'free'")))
    assert free.adaptation == Adaptation({"lease": 3})


def test_the_text_of_a_small_scenario() -> None:
    small = scenario(
        "[strategy]\nlease = 3\n'wie lang?' = 'ja'\n[deeco]\nrelay = true\nforget = 5\n"
        "[robots]\ncount = 1\nstart = [[12, 5, 0]]\n[places]\nareas = ['hall']\nper_robot = 0\n"
        "[[area]]\nname = 'hall'\nx = [1, 2.5]\ny = [-3, 4]\n"
        "[[event]]\nat = 1\nobstacle = [9, 12]\nradius = 0.2\n"
    )
    run = small.run.model_copy(update={"modules": None})
    assert to_toml(small.model_copy(update={"map": "/maps/a.yaml", "run": run})) == (
        'map = "/maps/a.yaml"\n'
        "\n"
        '[run]\nduration = 600.0\nstep_ms = 100\nseed = 1\nstrategy = "none"\n'
        "\n"
        '[strategy]\nlease = 3\n"wie lang?" = "ja"\n'
        "\n"
        "[deeco]\npublish = 1.0\nrelay = true\nhop_limit = 3\nrelay_delay = 1.0\n"
        "relay_below = 0.0\nforget = 5.0\n"
        "\n"
        '[robots]\ncount = 1\nmodel = "turtlebot2"\nstart = [\n    [12.0, 5.0, 0.0],\n]\n'
        "\n"
        '[places]\nareas = ["hall"]\nper_robot = 0\n'
        "\n"
        '[radio]\npreset = "chapter"\n'
        "\n"
        "[uncertainty]\nmap_error = 0.0\nglass = 0.0\nfurniture = 0\ndrift = 1.0\ndropout = 0.0\n"
        "\n"
        '[[area]]\nname = "hall"\nx = [1.0, 2.5]\ny = [-3.0, 4.0]\n'
        "\n"
        "[[event]]\nat = 1.0\nobstacle = [9.0, 12.0]\nradius = 0.2\n"
    )


def test_paths_are_relative_to_the_file_they_stand_in() -> None:
    text = (
        'map = "../maps/a.yaml"\n[robots]\nmodel = "kinds/tall.toml"\n'
        '[[robot]]\nid = "r1"\nmodel = "/flat.toml"\n[[robot]]\nid = "r2"\nmodel = "omnibox"\n'
    )
    read = parse(text, Path("/a/b/some.toml"))
    assert (read.map, read.robots.model) == ("/a/maps/a.yaml", "/a/b/kinds/tall.toml")
    assert read.run.modules == "/a/b"
    assert parse('map = "m"\n[run]\nmodules = "../c"', Path("/a/b/some.toml")).run.modules == "/a/b/../c"
    assert [robot.model for robot in read.robot] == ["/flat.toml", "omnibox"]


def _as_lists(value: Any) -> Any:
    """Tuples as the lists that a TOML file would give."""
    if isinstance(value, dict):
        return {name: _as_lists(item) for name, item in value.items()}
    return [_as_lists(item) for item in value] if isinstance(value, list | tuple) else value
