"""Commands `acrc record`: summarise, print, plot and check recordings."""

import json as json_
import sys
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from acrc_testbed.command_line.shared_options import Json, answer, argument, command_group, flag, option
from actors.installation.usage import OptionError, output_file

if TYPE_CHECKING:
    from acrc_testbed.recordings.message_formats import KeyStatistics
    from acrc_testbed.recordings.topics import LoggedMessage

_Growing = Annotated[Path, argument("OUT", "Folder of a run (may be in progress), or one recording.")]
_KEY = "Key: r1/drive, truth, */senses for all robots, or a full key"
_Begin = Annotated[float, option("S", "Begin at this simulated time.", "--from", min=0)]
_End = Annotated[float | None, option("S", "End at this simulated time.", "--to", min=0)]
_Follow = Annotated[bool, flag("Follow new messages until the run ends.", "--follow", "-f")]
_PERIOD_S = 1.0


def info(
    out: _Growing,
    keys: Annotated[list[str] | None, argument("[KEY…]", f"{_KEY}.  [default: a line per recording]")] = None,
    begin: _Begin = 0.0,
    end: _End = None,
    follow: _Follow = False,
    json: Json = False,
) -> None:
    """Summarise recordings, or the messages on a key.

    For each recording: time span, messages, bytes, completeness. For each KEY ('*': all): fields, and
    messages and bytes per simulated second.
    """
    if keys:
        _answer_rates(_messages(out, keys, begin, end, follow), follow=follow, json=json)
        return
    if follow or begin or end is not None:
        raise OptionError("--follow, --from, --to: require a KEY, such as '*'")
    from acrc_testbed.recordings import message_formats as figures

    found = figures.recording_statistics(out)
    lines = list(chain(*(figures.recording_sentences(one, topics=out.is_file()) for one in found)))
    answer([*lines, *([figures.total_sentence(found)] if len(found) > 1 else [])], found, json=json)


def echo(
    out: _Growing,
    keys: Annotated[list[str], argument("KEY…", f"{_KEY}; r1/log: output of r1's strategy.")],
    begin: _Begin = 0.0,
    end: _End = None,
    follow: _Follow = False,
    csv: Annotated[bool, flag("Print a table with a column per field.", "--csv")] = False,
    json: Annotated[bool, flag("Print a JSON object per line.", "--json")] = False,
) -> None:
    """Print messages, or lines of a log, with their times."""
    from acrc_testbed.recordings import message_formats

    if csv and json:
        raise OptionError("--csv: cannot be combined with --json")
    form = message_formats.OutputFormat["CSV" if csv else "JSON" if json else "TEXT"]
    if all(message_formats.is_log(key) for key in keys):
        logged = message_formats.read_logs(out, keys, begin, end, follow=follow)
        texts = message_formats.format_logs(logged, form, named=len(keys) > 1 or "*" in keys[0])
    else:
        texts = message_formats.format_messages(_messages(out, keys, begin, end, follow), form)
    is_empty = True
    for text in texts:
        print(text, flush=follow)
        is_empty = False
    if is_empty:
        print(f"{out}: nothing on {', '.join(keys)} in this interval", file=sys.stderr)


def plot(
    out: _Growing,
    key: Annotated[str, argument("KEY", f"{_KEY}.")],
    field: Annotated[str, argument("FIELD", "Field with a number: vx, odometry.x, robots[0].x.")],
    file: Annotated[Path, option("FILE", "Write the plot to a .png, or an .svg for papers.", "--out", "-o")],
    begin: _Begin = 0.0,
    end: _End = None,
    json: Json = False,
) -> None:
    """Plot a field over simulated time."""
    output_file("--out", file, ".png", ".svg")
    from acrc_testbed.recordings import message_formats
    from acrc_testbed.recordings.topics import short_key

    found = message_formats.series(_messages(out, [key], begin, end, False), field)
    from acrc_testbed.picture import style
    from deploy.run import out_folder

    with out_folder.convert_write_errors(file.parent):
        style.write({short_key(name): values for name, values in found.items()}, field, file)
    answer([str(file)], {"file": file}, json=json)


def check(
    out: Annotated[Path, argument("OUT", "Folder of a run, or one recording.")], json: Json = False
) -> None:
    """Check that the files of a run are unchanged.

    Compare recordings with their checksums, one another and the result, and all files with the seal. A single
    recording is compared with its checksums only.
    """
    from acrc_testbed.recordings import record_check
    from acrc_testbed.results import seal

    if out.is_file():
        data, sentence = record_check.check_recording(out)
        answer([sentence], data, json=json)
        return
    if not any(out.glob("*/*.mcap")) and (sealed := seal.check_seal(out)) is not None:
        answer([seal.seal_sentence(out, sealed)], {"sealed": sealed._asdict()}, json=json)
        return
    report = record_check.check_run(out)
    data = vars(report) | {"sealed": None if report.sealed is None else report.sealed._asdict()}
    answer([*record_check.check_sentences(report), seal.seal_sentence(out, report.sealed)], data, json=json)


app = command_group("Read and check the recordings of a run.", info, echo, plot, check)


def _messages(
    out: Path, keys: list[str], begin: float, end: float | None, follow: bool
) -> Iterator["LoggedMessage"]:
    from acrc_testbed.recordings import topics

    recorded = topics.follow(out, keys, lambda: not follow or topics.has_ended(out))
    return topics.within(recorded, begin, end)


def _answer_rates(recorded: Iterator["LoggedMessage"], *, follow: bool, json: bool) -> None:
    """Print the rates of each key at the end; with `follow` also about once a second."""
    from acrc_testbed.recordings.message_formats import KeyStatistics

    rates: dict[str, KeyStatistics] = {}
    due = time.monotonic() + _PERIOD_S
    for one in recorded:
        rates.setdefault(one.key, KeyStatistics()).add(one)
        if follow and time.monotonic() >= due:
            _print_rates(rates, json=json)
            due = time.monotonic() + _PERIOD_S
    _print_rates(rates, json=json)


def _print_rates(rates: dict[str, "KeyStatistics"], *, json: bool) -> None:
    from acrc_testbed.recordings import message_formats
    from acrc_testbed.recordings.topics import short_key

    by_key = sorted(rates.items(), key=lambda item: short_key(item[0]))
    figures = [rate.figures(key) for key, rate in by_key]
    if json:
        print(json_.dumps(figures), flush=True)
        return
    for one in figures:
        print("\n".join(message_formats.statistics_sentences(one)), flush=True)
