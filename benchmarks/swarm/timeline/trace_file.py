"""The timeline as a file in Chrome's trace event format, for Perfetto or chrome://tracing."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from actors.runtime.spans import Span
from benchmarks.swarm.timeline.watching import Watched

Event = dict[str, Any]
PARENT = "parent"


def check(path: Path) -> None:
    """Raise OptionError if a file cannot be written there, before anything is run for it."""
    if path.is_dir():
        raise OptionError(f"--timeline: {path} is a folder; must be a file")
    if not path.parent.is_dir():
        raise OptionError(f"--timeline: {path.parent} is no folder; must be one that exists")


def write(seen: Watched, path: Path) -> None:
    """Write the file; AcrcError where the system does not let it."""
    content = {
        "traceEvents": list(events(seen)),
        "displayTimeUnit": "ms",
        "otherData": {"robots": seen.robots, "steps": list(seen.window), "digest": seen.digest},
    }
    try:
        path.write_text(json.dumps(content, separators=(",", ":")) + "\n")
    except OSError as error:
        raise AcrcError(f"{path}: the timeline cannot be written: {error.strerror}") from None


def events(seen: Watched) -> Iterator[Event]:
    """Every process is one thread: its spans, with arrows from sending a message to taking it.

    Times are µs since the first span. `tdur` is the CPU of the main thread; `process_cpu_us` that of the
    whole process, with the thread of its mesh.
    """
    origin = min(spans[0].begin_ns for spans in seen.spans.values())
    sent = {(span.key, span.number) for spans in seen.spans.values() for span in spans if span.kind == "send"}
    for pid, (actor, spans) in enumerate(seen.spans.items(), start=1):
        yield from _named(pid, actor)
        cpu = 0
        for place, span in enumerate(spans):
            yield _slice(pid, span, origin, cpu)
            cpu += span.thread_ns
            message = span.key, span.number
            if span.kind == "send":
                yield _arrow("s", pid, span.begin_ns, origin, message)
            elif span.kind == "wait" and message in sent and place + 1 < len(spans):
                yield _arrow("f", pid, span.end_ns, origin, message) | {"bp": "e"}
    yield from _parent(seen, origin)


def _named(pid: int, actor: str) -> Iterator[Event]:
    for what, args in (("process_name", {"name": actor}), ("process_sort_index", {"sort_index": pid})):
        yield {"ph": "M", "name": what, "pid": pid, "tid": pid, "args": args}


def _slice(pid: int, span: Span, origin: int, cpu_ns: int) -> Event:
    args: dict[str, object] = {"step": span.step, "process_cpu_us": span.process_ns / 1e3}
    if span.kind == "wait":
        args |= {"missing": span.missing, "came": span.key, "number": span.number}
    elif span.kind == "send":
        args |= {"key": span.key, "number": span.number}
    what = brief(span.missing or span.key)
    return {
        "ph": "X",
        "cat": span.kind,
        "name": f"{span.kind} {what}".strip(),
        "pid": pid,
        "tid": pid,
        "ts": (span.begin_ns - origin) / 1e3,
        "dur": (span.end_ns - span.begin_ns) / 1e3,
        "tts": cpu_ns / 1e3,
        "tdur": span.thread_ns / 1e3,
        "args": args,
    }


def _arrow(end: str, pid: int, at_ns: int, origin: int, message: tuple[str, int]) -> Event:
    name = "{}#{}".format(*message)
    where = {"pid": pid, "tid": pid, "ts": (at_ns - origin) / 1e3}
    return {"ph": end, "cat": "message", "name": brief(message[0]), "id": name} | where


def _parent(seen: Watched, origin: int) -> Iterator[Event]:
    """Instants only: it hears once a second of simulated time how far the run is, and nobody waits for it."""
    pid = len(seen.spans) + 1
    yield from _named(pid, PARENT)
    for notice in seen.notices:
        at = {"pid": pid, "tid": pid, "ts": (notice.at_ns - origin) / 1e3, "s": "t"}
        yield {"ph": "i", "name": "progress", "args": {"step": notice.step}} | at


def brief(key: str) -> str:
    """A key without what all have in common: `r5/drive`, `truth`."""
    return "/".join(key.split("/")[2:]).removeprefix("infra/")
