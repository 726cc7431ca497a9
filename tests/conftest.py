"""Settings of all tests: order of files, claims, and skips, which are failures under CI."""

import gc
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
import pytest
from hypothesis import settings

from actors.processes import launch
from tests import warm

if TYPE_CHECKING:
    from tests.control.browser import Browser

if "CI" not in os.environ:  # there hypothesis has a profile of its own, without a limit as well
    settings.register_profile("here", deadline=None)  # no test may fail because others take the processor
    settings.load_profile("here")

pytest_plugins = ["tests.recorded_runs"]

LONGEST: Final = (
    "swarm/test_known_digests.py",
    "swarm/test_house.py",
    "hosts/test_hosted_runs.py",
    "cli/test_story.py",
    "swarm/test_outcomes.py",
    "failures/test_failures.py",
    "failures/test_kills.py",
    "pictures/test_pictures.py",
    "onboard/test_standstill.py",
    "experiments/test_campaign.py",
    "navigation/test_goals.py",
    "development/test_wheel.py",
)
"""Files of over 10 s, the longest first: started last, they would keep one worker busy alone."""
CLAIM: Final = "claim"
"""The marker of tests that check a statement of docs/how-true.md: `@pytest.mark.claim("name")`."""
_RANK: Final = {Path(__file__).parent / name: number for number, name in enumerate(LONGEST)}
_SKIPPED: list[str] = []
_CLAIM_REPORT: list[Path] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("claims")
    group.addoption("--full", action="store_true", help="Run claim tests in full size.")
    group.addoption("--claim", action="append", metavar="NAME", help="Run only tests of this claim.")
    group.addoption("--claim-report", type=Path, metavar="FILE", help="Append a JSON line per claim test.")


def pytest_configure(config: pytest.Config) -> None:
    """Let tests inherit neither an ignored Ctrl-C nor another project's modules."""
    if (report := config.getoption("--claim-report")) is not None and not hasattr(config, "workerinput"):
        _CLAIM_REPORT.append(report)
    # Programs and strategies of the tests lie beside the project, where no process of it looks by itself.
    os.environ.setdefault("PYTHONPATH", str(Path(__file__).parents[1]))
    gc.disable()  # all that modules and tests are made of stays: looking for garbage in it finds none
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module")
def forked_servers() -> Iterator[None]:
    """Start the forkservers of runs in the test's own process as forks of the preloaded process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "begin", warm.begin_server)
        yield


@pytest.fixture
def full(request: pytest.FixtureRequest) -> bool:
    """True if `--full` asks for the size whose figures docs/how-true.md reports."""
    return bool(request.config.getoption("--full"))


@pytest.fixture
def browser(tmp_path: Path) -> "Iterator[Browser]":
    """A Chromium with an empty page; skips the test where there is none."""
    found = pytest.importorskip(
        "tests.control.browser", reason="websockets comes with `./acrc run --control`"
    )
    if found.CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    with found.Browser(tmp_path / "browser", "about:blank") as page:
        yield page


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _select_claims(config, items)
    items.sort(key=lambda item: _RANK.get(item.path, len(_RANK)))


def _select_claims(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Note each test's claim in its report; with `--claim`, keep the tests of those claims only."""
    wanted = config.getoption("--claim")
    for item in items:
        if (mark := item.get_closest_marker(CLAIM)) is not None:
            item.user_properties.append((CLAIM, mark.args[0]))
            if config.getoption("--full"):
                item.add_marker(pytest.mark.timeout(0))
    if wanted:
        items[:] = [item for item in items if dict(item.user_properties).get(CLAIM) in wanted]


def pytest_collection_finish() -> None:
    """From here on garbage is looked for in what the tests themselves make."""
    gc.freeze()
    gc.enable()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.skipped and not hasattr(report, "wasxfail"):
        _SKIPPED.append(report.nodeid)
    _report_claim(report)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Reduce recorded properties to plain values: pytest-xdist sends no others to its controller."""
    report: pytest.TestReport = yield  # type: ignore[assignment]
    report.user_properties = [
        (name, msgspec.to_builtins(value, enc_hook=lambda other: getattr(other, "item", other.__str__)()))
        for name, value in report.user_properties
    ]
    return report  # type: ignore[return-value]


def _report_claim(report: pytest.TestReport) -> None:
    """Append a row about a claim's test to the report file; `reason`: of a skip."""
    properties = dict(report.user_properties)
    if _CLAIM_REPORT and CLAIM in properties and (report.when == "call" or report.outcome != "passed"):
        row = {
            "claim": properties.pop(CLAIM),
            "test": report.nodeid,
            "outcome": report.outcome,
            "seconds": round(report.duration, 2),
            "figures": properties,
            "reason": str(report.longrepr[2]) if isinstance(report.longrepr, tuple) else "",
        }
        with _CLAIM_REPORT[0].open("a") as file:
            file.write(json.dumps(row) + "\n")


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
