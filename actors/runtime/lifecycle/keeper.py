"""The process that stays outside of a robot's process namespace, and ends with it as one.

Only a child enters a new process namespace (pid_namespaces(7)). So whoever was started becomes the keeper,
and the robot goes on in a child of it, process 2 of the namespace. Process 1 is a second child, for the
kernel ends a namespace, with all that lives in it, when its process 1 ends.
"""

import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Collection
from typing import Final, NoReturn

from actors.runtime.lifecycle.linux import die_with_parent

_FORWARDED: Final = (
    signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2,
)  # fmt: skip
_spent: list[float] = []
"""CPU time of this process's forerunners, which became keepers, s."""


def enter_namespace(
    parent: int | None, prepare: Callable[[], None] = lambda: None, private: Collection[int] = ()
) -> None:
    """Go on in a child, the new process namespace's only one; this process becomes its keeper.

    `prepare`: what the keeper does first, beside the child; if that fails, it must end the process.
    `private`: descriptors that it alone keeps.

    Returns in the child. To be called after unshare(CLONE_NEWPID), with one thread, and with no descriptor
    open that the namespace must not share. The keeper ends as the child does, with the same exit code or by
    the same signal, once no process of the namespace is left; it passes on what it is told by signals. If the
    keeper is killed, or `parent` ends (a process id; None: nobody is looked after), the whole namespace is.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    spent = cpu_s()
    pulse, lifeline = os.pipe()
    nothing = os.open(os.devnull, os.O_RDWR)  # now, for the child is about to replace /dev
    first = os.fork()
    if first == 0:
        for handle in (lifeline, *private):
            os.close(handle)
        _be_first(pulse, nothing)
    child = os.fork()
    if child == 0:
        for handle in (pulse, lifeline, nothing, *private):
            os.close(handle)
        os.setsid()  # or a signal to the own group would reach the group of the keeper
        _spent.append(spent)
        return
    os.close(pulse)
    try:
        prepare()
        status = _keep(child, nothing, parent)
    finally:  # the keeper must never return into the robot's program
        os.close(lifeline)
        os.waitpid(first, 0)
    _end_alike(status)


def add_spent(seconds: float) -> None:
    """Count CPU time of another process, which was this one's work, in `cpu_s`."""
    _spent.append(seconds)


def cpu_s() -> float:
    """CPU time of this process, s; with that of the keepers which it was before."""
    return time.process_time() + sum(_spent)


def _be_first(pulse: int, nothing: int) -> NoReturn:
    """Process 1: reaps orphans by ignoring their ends, and ends when the keeper has."""
    try:
        os.setsid()
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        _let_go(nothing)
        os.read(pulse, 1)
    finally:
        os._exit(0)


def _keep(child: int, nothing: int, parent: int | None) -> int:
    """Stay until the child has ended; its status."""
    for number in _FORWARDED:
        signal.signal(number, lambda got, _: os.kill(child, got))
    _let_go(nothing)
    if parent is not None:
        die_with_parent(parent)
    return os.waitpid(child, 0)[1]


def _let_go(nothing: int) -> None:
    """Hold neither the log nor anything else that was inherited."""
    os.chdir("/")
    for number in (0, 1, 2):
        os.dup2(nothing, number)


def _end_alike(status: int) -> NoReturn:
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if -code not in {signal.SIGKILL, signal.SIGSTOP}:
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code if code >= 0 else 128 - code)
