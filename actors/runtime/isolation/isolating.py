"""Whether a run's robots are shut off, and what the user is told if they are not."""

from dataclasses import dataclass

from actors.console import screen
from actors.runtime.isolation import container, sandbox

OPEN = (
    "each can read the others' passwords, files and memory, and reach them past the radio; "
    "a strategy that is not out to cheat gives the same result"
)


@dataclass(frozen=True)
class IsolationChoice:
    """How robots' processes will run."""

    isolate: bool
    warning: str = ""
    """What is missing, and why, in a sentence; empty if nothing is."""


def choose(wanted: bool | None, *, debugged: bool = False, elsewhere: str | None = None) -> IsolationChoice:
    """What becomes of the wish `wanted` (None: as well as the machine can) here.

    `debugged`: a debugger has to reach the process. `elsewhere`: why it is not to be had on another computer
    that the run has processes on; None if it is. Raises IsolationError where isolation is asked for and
    not to be had.
    """
    if wanted is False or (wanted is None and debugged):
        option = "--no-isolate" if wanted is False else "--debugpy"
        return IsolationChoice(False, f"{option}: robots run as plain processes; {OPEN}")
    reason = sandbox.available() or elsewhere
    if reason is None:
        return IsolationChoice(True)
    if wanted:
        raise sandbox.IsolationError(reason)
    cause = reason.removesuffix(f"; {container.advice()}")
    helps = f"; {container.remedy()}" if container.kind() and cause != reason else ""
    return IsolationChoice(False, f"robots run as plain processes, because {cause}; {OPEN}{helps}")


def warn(choice_warning: str) -> None:
    """Say on standard error what is missing, if anything is."""
    if choice_warning:
        console = screen(stderr=True)
        console.print(f"acrc: {choice_warning}", style="yellow")
