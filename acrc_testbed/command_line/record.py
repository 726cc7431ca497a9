"""`acrc record`: what a run has recorded, in figures, in full, drawn, and checked."""

import json as json_
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acrc_testbed.command_line.options import Json, answer, argument, flag, option
from actors.installation.usage import OptionError, output_file

if TYPE_CHECKING:
    from acrc_testbed.recordings.message_formats import KeyStatistics
    from acrc_testbed.recordings.topics import LoggedMessage

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
_Recorded = Annotated[Path, argument("OUT", "A run's folder, or one recording.")]
_Growing = Annotated[Path, argument("OUT", "A run's folder, also while it goes on, or one recording.")]
_KEY = "r1/drive, truth, */senses for all robots, or in full"
_Begin = Annotated[float, option("S", "Begin at this simulated second.", "--from", min=0)]
_End = Annotated[float | None, option("S", "End at this simulated second.", "--to", min=0)]
_Follow = Annotated[bool, flag("Follow what the run adds, to its end.", "--follow", "-f")]
_EVERY_S = 1.0


@app.command()
def info(
    out: _Growing,
    keys: Annotated[list[str] | None, argument("[KEY…]", f"{_KEY}.  [default: a line per recording]")] = None,
    begin: _Begin = 0.0,
    end: _End = None,
    follow: _Follow = False,
    json: Json = False,
) -> None:
    """Summarise recordings, or the messages on a key.

    For each recording: span, messages, bytes, whether it is complete. For each KEY ('*': all): its fields,
    and messages and bytes per simulated second.
    """
    if keys:
        _tell_keys(_messages(out, keys, begin, end, follow), follow=follow, json=json)
        return
    if follow or begin or end is not None:
        raise OptionError("--follow, --from, --to: must stand beside a KEY, such as '*'")
    from acrc_testbed.recordings import message_formats as figures

    found = figures.info(out)
    said = list(chain(*(figures.sentences(one, topics=out.is_file()) for one in found)))
    answer([*said, *([figures.total_sentence(found)] if len(found) > 1 else [])], found, json=json)


@app.command()
def echo(
    out: _Growing,
    keys: Annotated[list[str], argument("KEY…", f"{_KEY}; r1/log: what r1's strategy printed.")],
    begin: _Begin = 0.0,
    end: _End = None,
    follow: _Follow = False,
    csv: Annotated[bool, flag("Print a table: a column for each field.", "--csv")] = False,
    json: Annotated[bool, flag("Print a JSON object for each line.", "--json")] = False,
) -> None:
    """Print messages, or lines of a log, with their time."""
    from acrc_testbed.recordings import message_formats

    if csv and json:
        raise OptionError("--csv, --json: must be one of them")
    form = (
        message_formats.OutputFormat.CSV
        if csv
        else message_formats.OutputFormat.JSON
        if json
        else message_formats.OutputFormat.TEXT
    )
    if all(message_formats.is_log(key) for key in keys):
        told = message_formats.read_logs(out, keys, begin, end, follow=follow)
        texts = message_formats.format_logs(told, form, named=len(keys) > 1 or "*" in keys[0])
    else:
        texts = message_formats.format_messages(_messages(out, keys, begin, end, follow), form)
    for text in texts:
        print(text, flush=follow)


@app.command()
def plot(
    out: _Growing,
    key: Annotated[str, argument("KEY", f"{_KEY}.")],
    field: Annotated[str, argument("FIELD", "A number: vx, odometry.x, robots[0].x.")],
    file: Annotated[Path, option("FILE", "The drawing: a .png, or an .svg for papers.", "--out", "-o")],
    begin: _Begin = 0.0,
    end: _End = None,
    json: Json = False,
) -> None:
    """Draw a field over simulated time."""
    output_file("--out", file, ".png", ".svg")
    from acrc_testbed.recordings import message_formats
    from acrc_testbed.recordings.topics import short_key

    found = message_formats.series(_messages(out, [key], begin, end, False), field)
    from acrc_testbed.picture import style
    from deploy.run import out_folder

    with out_folder.writing(file.parent):
        style.write({short_key(name): values for name, values in found.items()}, field, file)
    answer([str(file)], {"file": file}, json=json)


@app.command()
def check(out: _Recorded, json: Json = False) -> None:
    """Check whether a run's files are as it left them.

    Compare recordings with their checksums, one another and the result, and all files with the seal. A single
    recording is compared with its checksums only.
    """
    from acrc_testbed.recordings import record_check
    from acrc_testbed.results import seal

    if out.is_file():
        plainly, said = record_check.check_recording(out)
        answer([said], plainly, json=json)
        return
    if not any(out.glob("*/*.mcap")) and (sealed := seal.check_seal(out)) is not None:
        answer([seal.sentence(out, sealed)], {"sealed": sealed._asdict()}, json=json)
        return
    report = record_check.check(out)
    told = vars(report) | {"sealed": None if report.sealed is None else report.sealed._asdict()}
    answer([*record_check.sentences(report), seal.sentence(out, report.sealed)], told, json=json)


def _messages(
    out: Path, keys: list[str], begin: float, end: float | None, follow: bool
) -> Iterator["LoggedMessage"]:
    from acrc_testbed.recordings import topics

    recorded = topics.follow(out, keys, lambda: not follow or topics.has_ended(out))
    return topics.within(recorded, begin, end)


def _tell_keys(recorded: Iterator["LoggedMessage"], *, follow: bool, json: bool) -> None:
    """Say at the end what is on each key; with `follow` also from time to time what there is by then."""
    from acrc_testbed.recordings.message_formats import KeyStatistics

    found: dict[str, KeyStatistics] = {}
    due = time.monotonic() + _EVERY_S
    for one in recorded:
        found.setdefault(one.key, KeyStatistics()).take(one)
        if follow and time.monotonic() >= due:
            _print_keys(found, json=json)
            due = time.monotonic() + _EVERY_S
    _print_keys(found, json=json)


def _print_keys(found: dict[str, "KeyStatistics"], *, json: bool) -> None:
    from acrc_testbed.recordings import message_formats
    from acrc_testbed.recordings.topics import short_key

    by_key = sorted(found.items(), key=lambda item: short_key(item[0]))
    told = [rate.figures(key) for key, rate in by_key]
    if json:
        print(json_.dumps(told), flush=True)
        return
    for one in told:
        print("\n".join(message_formats.statistics_sentences(one)), flush=True)
