"""What holds for all tests: under CI a skipped test is a failure, because there nobody would see it."""

import os
import signal
from typing import Any

import pytest

_SKIPPED: list[str] = []


def pytest_configure() -> None:
    """What a shell starts in the background ignores Ctrl-C, and what the tests start would inherit that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.skipped and not hasattr(report, "wasxfail"):
        _SKIPPED.append(report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.skipped:
        _SKIPPED.append(report.nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """A worker of pytest-xdist has ended: modules that it skipped whole are known to it alone."""
    told = getattr(node, "workeroutput", {}).get("skipped", ())
    _SKIPPED.extend(name for name in told if name not in _SKIPPED)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if (told := getattr(session.config, "workeroutput", None)) is not None:
        told["skipped"] = _SKIPPED
        return
    if _under_ci() and _SKIPPED and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if _under_ci() and _SKIPPED:
        terminalreporter.write_line(
            f"CI is set, so skipped tests are failures; skipped: {', '.join(_SKIPPED)}", red=True
        )


def _under_ci() -> bool:
    return os.environ.get("CI", "").lower() not in {"", "0", "false"}
