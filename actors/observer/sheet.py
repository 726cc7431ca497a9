"""What is drawn goes into a file, and to a viewer where one listens."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import rerun as rr

from actors.observer.drawing.layout import Arrangement, beside, layout
from actors.runtime.errors import AcrcError

APPLICATION: Final = "acrc-testbed-4"
"""A viewer keeps the layout that it has seen of an application: another layout, another name."""
FLUSH: Final = 10.0
"""How long a slow viewer may take to take in what it was sent, s."""


class Sheet:
    """A recording of rerun's with the layout in it; a context manager that finishes the file."""

    def __init__(
        self, path: Path, what: Arrangement | Sequence[Arrangement], *, name: str, send_to: str | None = None
    ) -> None:
        """`what`: a run, or several beside one another. `send_to`: a viewer's address.

        AcrcError if the file cannot be written.
        """
        try:
            path.open("wb").close()
        except OSError as error:
            raise AcrcError(f"{path}: the view cannot be written: {error.strerror}.") from error
        self.path = path
        self.lost = False
        """True once the viewer is gone; the file has everything all the same."""
        self.recording = rr.RecordingStream(APPLICATION)
        self.recording.set_log_time_enabled(False)
        arranged = layout(what) if isinstance(what, Arrangement) else beside(what)
        viewers = [] if send_to is None else [rr.GrpcSink(send_to)]
        self.recording.set_sinks(rr.FileSink(path), *viewers, default_blueprint=arranged)
        self.recording.send_recording_name(name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.flush()
        self.recording.disconnect()

    def flush(self) -> None:
        """Let file and viewer have all that was drawn."""
        try:
            self.recording.flush(timeout_sec=FLUSH)
        except RuntimeError:  # rerun says so when a viewer is gone
            self.lost = True
