"""`acrc topic`: what was said on a key, how often and how much, from recordings, also while a run goes on."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actors.installation.usage import wrong_value

if TYPE_CHECKING:
    from observation.recordings.rates import Rate
    from observation.recordings.topics import Recorded

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
_Target = Annotated[
    Path, typer.Argument(metavar="OUT", help="A run's folder, also while it goes on, or one recording.")
]
_Key = Annotated[
    str, typer.Argument(metavar="KEY", help="r1/drive, truth, */senses for all robots, or in full.")
]
_Follow = Annotated[bool, typer.Option("--follow", "-f", help="Follow what the run adds, to its end.")]
_EVERY_S = 1.0


@app.command(name="list")
def list_(out: _Target) -> None:
    """Say which keys something was recorded on, what is said there, and in which fields."""
    from observation.recordings.plain import columns
    from observation.recordings.topics import known, short

    found = known(out)
    width = max((len(short(key)) for key in found), default=0)
    for key, topic in found.items():
        print(f"{short(key):{width}}  {topic.kind.__name__}: {', '.join(columns(topic.kind))}")


@app.command()
def echo(
    out: _Target,
    key: _Key,
    table: Annotated[bool, typer.Option("--csv", help="As a table: a column for each field.")] = False,
    follow: _Follow = False,
) -> None:
    """Print every message, with its simulated time."""
    from observation.recordings import lines

    recorded = _messages(out, key, follow)
    for text in lines.table(recorded) if table else map(lines.line, recorded):
        print(text, flush=follow)


@app.command()
def hz(out: _Target, key: _Key, follow: _Follow = False) -> None:
    """Say how often messages come, in simulated time."""
    from observation.recordings.rates import often

    _tell(out, key, follow, often)


@app.command()
def bw(out: _Target, key: _Key, follow: _Follow = False) -> None:
    """Say how many bytes messages have, and how many that is in a simulated second."""
    from observation.recordings.rates import heavy

    _tell(out, key, follow, heavy)


@app.command()
def plot(
    out: _Target,
    key: _Key,
    field: Annotated[str, typer.Argument(metavar="FIELD", help="A number: vx, odometry.x, robots[0].x.")],
    png: Annotated[Path, typer.Option("--png", metavar="FILE", help="Where to; .svg for papers.")],
) -> None:
    """Draw a field over simulated time."""
    if png.suffix not in {".png", ".svg"} or not png.absolute().parent.is_dir():
        raise wrong_value("--png", png, "a file in a folder that exists, its name ending in .png or .svg")
    from observation.recordings import lines
    from observation.recordings.topics import short

    found = lines.series(_messages(out, key, False), field)
    from deploy.run import out_folder
    from observation.picture import series

    with out_folder.writing(png.parent):
        series.write({short(name): values for name, values in found.items()}, field, png)
    print(png)


def _messages(out: Path, key: str, follow: bool) -> Iterator["Recorded"]:
    from observation.recordings import topics

    return topics.follow(out, key, lambda: not follow or topics.has_ended(out))


def _tell(out: Path, key: str, follow: bool, words: Callable[[str, "Rate"], str]) -> None:
    """The figures at the end; with `follow`, those so far from time to time, too."""
    from observation.recordings.rates import Rate

    found: dict[str, Rate] = {}
    due = time.monotonic() + _EVERY_S
    for one in _messages(out, key, follow):
        found.setdefault(one.key, Rate()).take(one)
        if follow and time.monotonic() >= due:
            _print(found, words)
            due = time.monotonic() + _EVERY_S
    _print(found, words)


def _print(found: dict[str, "Rate"], words: Callable[[str, "Rate"], str]) -> None:
    for name, rate in found.items():
        print(words(name, rate), flush=True)
