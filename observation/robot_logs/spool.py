"""Messages set aside in a temporary file until it is their turn: memory holds where they are."""

import tempfile
from collections.abc import Iterable, Iterator
from typing import Self

from observation.robot_logs.contents import LogEntry, LogForm


class Spool:
    """Keeps encoded messages; a context manager that takes the file away."""

    def __init__(self, form: LogForm) -> None:
        self._form = form
        self._file = tempfile.TemporaryFile()  # noqa: SIM115
        self._kept: list[tuple[int, str, int, int]] = []
        """When each is logged, its topic, where it begins in the file, and its bytes."""
        self._end = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def extend(self, entries: Iterable[LogEntry]) -> None:
        """Set messages aside."""
        for one in entries:
            assert not isinstance(one.content, bytes)
            data = self._form.encode(one.content, one.stamp)
            self._file.write(data)
            self._kept.append((one.logged, one.topic, self._end, len(data)))
            self._end += len(data)

    def entries(self) -> Iterator[LogEntry]:
        """All of them in order of time; what is of one instant by topic, then as it came."""
        for logged, topic, begin, size in sorted(self._kept):
            self._file.seek(begin)
            yield LogEntry(logged, topic, self._file.read(size), logged)
