"""Pytest configuration: order of files, claims, and skips, which are failures under CI."""

import gc
import json
import os
import signal
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import msgspec
import pytest
from hypothesis import settings

from actors.floor.grid import SharedCache
from actors.processes import launcher
from tests import warm

if TYPE_CHECKING:
    from tests.control.browser import Browser

if "CI" not in os.environ:  # hypothesis has its own profile for CI, also without a deadline
    settings.register_profile("here", deadline=None)  # the machine may be busy
    settings.load_profile("here")

V = TypeVar("V")
pytest_plugins = ["tests.recorded_runs"]

LONGEST: Final = (
    "onboard/test_standstill.py",
    "swarm/test_known_digests.py",
    "swarm/test_transports.py",
    "hosts/test_hosted_runs.py",
    "cli/test_workflow.py",
    "swarm/test_outcomes.py",
    "failures/test_failures.py",
    "failures/test_kills.py",
    "pictures/test_pictures.py",
    "experiments/test_campaign.py",
    "navigation/test_goals.py",
    "development/test_wheel.py",
)
"""Files of over 10 s, the longest first, so that none runs alone at the end."""
CLAIM: Final = "claim"
"""Marker of tests that check a claim of docs/how-true.md: `@pytest.mark.claim("name")`."""
_RANK: Final = {Path(__file__).parent / name: number for number, name in enumerate(LONGEST)}
_SKIPPED: list[str] = []
_CLAIM_REPORT: list[Path] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("claims")
    group.addoption("--full", action="store_true", help="Run claim tests in full size.")
    group.addoption("--claim", action="append", metavar="NAME", help="Run only tests of this claim.")
    group.addoption("--claim-report", type=Path, metavar="FILE", help="Append a JSON line per claim test.")


def pytest_configure(config: pytest.Config) -> None:
    """Set module path, garbage collection and Ctrl-C for all tests."""
    if (report := config.getoption("--claim-report")) is not None and not hasattr(config, "workerinput"):
        _CLAIM_REPORT.append(report)
    # Programs and strategies of the tests are outside the installed packages.
    os.environ.setdefault("PYTHONPATH", str(Path(__file__).parents[1]))
    _keep_shared_data()
    gc.disable()  # collection creates no garbage
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _keep_shared_data() -> None:
    """Keep recent maps, cost grids and fields, which caches hold weakly, for the next run of this worker."""
    get, kept = SharedCache.get, deque[object](maxlen=64)

    def get_and_keep(self: SharedCache[V], content: Hashable, make: Callable[[], V]) -> V:
        value = get(self, content, make)
        if type(value).__module__.startswith("actors."):
            kept.append(value)
        return value

    SharedCache.get = get_and_keep  # type: ignore[method-assign]


@pytest.fixture(scope="module")
def forked_servers() -> Iterator[None]:
    """Start the forkservers of runs in the test's own process as forks of the preloaded process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launcher, "start_server", warm.begin_server)
        yield


@pytest.fixture
def full(request: pytest.FixtureRequest) -> bool:
    """Return whether `--full` requests the size reported in docs/how-true.md."""
    return bool(request.config.getoption("--full"))


@pytest.fixture
def browser(tmp_path: Path) -> "Iterator[Browser]":
    """Yield a Chromium with an empty page; skip the test without Chromium."""
    found = pytest.importorskip(
        "tests.control.browser", reason="websockets is installed by `./acrc run --control`"
    )
    if found.CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    with found.Browser(tmp_path / "browser", "about:blank") as page:
        yield page


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _select_claims(config, items)
    items.sort(key=lambda item: _RANK.get(item.path, len(_RANK)))


def _select_claims(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Record each test's claim in its report; with `--claim`, select the tests of those claims."""
    wanted = config.getoption("--claim")
    for item in items:
        if (mark := item.get_closest_marker(CLAIM)) is not None:
            item.user_properties.append((CLAIM, mark.args[0]))
            if config.getoption("--full"):
                item.add_marker(pytest.mark.timeout(0))
    if wanted:
        items[:] = [item for item in items if dict(item.user_properties).get(CLAIM) in wanted]


def pytest_collection_finish() -> None:
    """Enable garbage collection for objects created by the tests."""
    gc.freeze()
    frozen = gc.get_freeze_count()
    # Each run in memory asks for the count, and counting takes 0.07 s here.
    gc.get_freeze_count = lambda: frozen
    gc.enable()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.skipped and not hasattr(report, "wasxfail"):
        _SKIPPED.append(report.nodeid)
    _report_claim(report)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Convert recorded properties to plain values, as pytest-xdist requires."""
    report: pytest.TestReport = yield  # type: ignore[assignment]
    report.user_properties = [
        (name, msgspec.to_builtins(value, enc_hook=lambda other: getattr(other, "item", other.__str__)()))
        for name, value in report.user_properties
    ]
    return report  # type: ignore[return-value]


def _report_claim(report: pytest.TestReport) -> None:
    """Append a row about a claim's test to the report file; `reason`: reason of a skip."""
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
    """Collect skipped modules from an exited pytest-xdist worker."""
    skipped = getattr(node, "workeroutput", {}).get("skipped", ())
    _SKIPPED.extend(name for name in skipped if name not in _SKIPPED)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if (output := getattr(session.config, "workeroutput", None)) is not None:
        output["skipped"] = _SKIPPED
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
