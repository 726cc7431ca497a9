"""Messages, help and results of the command line."""

import io
import os
import shlex
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from acrc_testbed.command_line import development, run
from acrc_testbed.command_line.development import Check, run_checks
from acrc_testbed.command_line.documentation import command_tree
from acrc_testbed.results import summary
from acrc_testbed.results.outcome import DeecoResult, NavigationResult
from acrc_testbed.results.result import Origin, RobotResult, RunResult
from actors.installation import usage
from actors.installation.repository import REPOSITORY
from actors.installation.repository import REPOSITORY as ROOT
from actors.installation.version import package_version
from actors.processes import kernel_compilation
from actors.task.task import Value
from actors.world.sensing import PoseError
from cleaning.strategies import STRATEGIES
from cleaning.task import CleaningTask
from tests import in_process

TREE = command_tree()


HEAVY = {
    *("distributed", "matplotlib", "numba", "pyarrow", "pydantic", "pymunk", "rerun", "scipy", "zenoh"),
    *("PIL", "mcap", "msgspec", "numpy", "yaml", "acrc_testbed.benchmarks"),
}


def acrc(*arguments: str, cwd: Path = ROOT) -> tuple[int, str, str]:
    done = in_process.acrc(*arguments, cwd=cwd, env={"PATH": ""})
    return done.returncode, done.stdout, done.stderr


def test_a_wrong_scenario_is_one_line_and_exit_code_1(tmp_path: Path) -> None:
    file = tmp_path / f"{'long' * 30}.toml"
    file.write_text('map = "[bold]"\n[run]\nsed = 1\n')
    assert acrc("run", str(file)) == (1, "", f"acrc: {file}: unknown key run.sed; did you mean run.seed?\n")
    for name in ("chapter", "scenarios/chaptr.toml"):
        sentence = f"acrc: {name}: file not found; did you mean scenarios/chapter.toml?\n"
        assert acrc("run", name) == (1, "", sentence)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("run --step 15", "--step: 15; must be a multiple of the 10 ms physics sub-step, from 10 to 100"),
        ("run --robos 3", "--robos: unknown option of acrc run; did you mean --robots?"),
        ("rum", "rum: unknown command of acrc; did you mean run?"),
        ("list nothing", "nothing: unknown command of acrc list; choose from strategies, presets, "
         "models, scenarios, maps"),
        ("fleet keys", "FLEET.toml: missing; see acrc fleet keys --help"),
        ("run --seed", "--seed: requires a value"),
        ("run --view=3", "--view: takes no value"),
        ("run --qqqq", "--qqqq: unknown option of acrc run; see acrc run --help"),
        ("run a b c", "run: unexpected argument b c; usage: acrc run [OPTIONS] [SCENARIO.toml]"),
        ("run --timeout soon", "--timeout: soon; must be a number from 1 to 86400"),
        ("fleet keys f.toml --days x", "--days: x; must be a whole number"),
        ("verify radio --data x --runs 0", "--runs: 0; must be a whole number from 1 to 10000"),
        ("verify radio --runs 3", "--runs: requires --data, the data to compare with"),
        ("bench x", "NAME: x; must be one of swarm, budget, beside, hosts, start, radio, world"),
        ("run --strategy prayer", "--strategy: unknown strategy 'prayer'; choose from "
         f"{', '.join(sorted(STRATEGIES))}, or give module:function of your own, such as prayer:behaviour"),
        ("order out shout", "VERB: shout; must be one of: kill ROBOT, freeze ROBOT, thaw ROBOT, "
         "restart ROBOT, move ROBOT X Y HEADING, jam X Y RADIUS SECONDS, lose ROBOT SENDER, "
         "obstacle X Y RADIUS, wall X Y TO_X TO_Y, give ROBOT X Y|JSON, close X Y, open X Y, pause, resume, "
         "step [N], speed X|max, stop"),
    ],
)  # fmt: skip
def test_usage_errors_have_one_form(words: str, sentence: str) -> None:
    assert acrc(*words.split()) == (2, "", f"acrc: {sentence}\n")


def test_acrc_help_is_the_same_as_the_option() -> None:
    assert acrc("--version")[1].startswith(f"acrc {package_version()}")
    assert acrc("help") == acrc("--help")
    assert acrc("help", "list", "maps") == acrc("list", "maps", "--help")


def test_the_default_folder_is_the_newest_run(tmp_path: Path) -> None:
    none = "acrc: OUT: missing, and runs/ contains no run; give a run's folder\n"
    assert acrc("view", "--png", cwd=tmp_path) == (2, "", none)
    for name in ("a", "b"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "scenario.toml").touch()
    os.utime(tmp_path / "runs" / "a" / "scenario.toml", (1e9, 1e9))
    assert acrc("view", "--png", cwd=tmp_path)[2].splitlines()[0] == "acrc: newest run: runs/b"
    said = f"acrc: OUT: missing; example: {REPOSITORY / 'acrc'} order runs/b kill r1\n"
    assert acrc("order", "kill", "r1", cwd=tmp_path) == (2, "", said)


def test_help_fits_into_80_columns() -> None:
    for words, command in TREE.items():
        context = command.make_context(words, [], resilient_parsing=True, terminal_width=80)
        for line in context.get_help().splitlines():
            assert len(line) <= 80, (words, line)
            assert "..." not in line or line.startswith("Usage: "), (words, line)


RUN = "numpy msgspec PIL yaml mcap numba zenoh"
IMPORTED = [
    [
        ("list strategies", ""),
        ("run --help", ""),
        ("scenario maps/corridor.yaml", "numpy msgspec PIL yaml"),
        ("scenario scenarios/corridor.toml", "numpy msgspec PIL yaml"),
    ],
    [("run --bus memory --robots 2 --duration 1 --out OUT", f"{RUN} pymunk")],
    [("causes OUT", RUN), ("view OUT --png", f"{RUN} matplotlib")],
]
"""Commands by process, with the heavy modules that each imports; among them are those of earlier commands."""


def test_a_command_imports_what_it_uses(tmp_path: Path) -> None:
    program = (
        "import sys, acrc_testbed.command_line.app as a\n"
        "for words in sys.argv[1:]:\n"
        "    a.app(words.split(), standalone_mode=False)\n"
        "    print('imported', *sys.modules)"
    )
    for commands in IMPORTED:
        called = [words.replace("OUT", str(tmp_path / "run")) for words, _ in commands]
        done = subprocess.run(
            [sys.executable, "-P", "-c", program, *called],
            cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        lines = [line.split() for line in done.stdout.splitlines() if line.startswith("imported ")]
        for (words, heavy), imported in zip(commands, lines, strict=True):
            assert HEAVY.intersection(imported) == {*heavy.split()}, words


def test_commands_for_developers_are_listed_separately() -> None:
    code, out, _ = acrc("--help")
    users, developers = out.partition("Commands for developers of the testbed:\n")[::2]
    assert code == 0
    for name in ("run", "order", "record", "list", "fleet", "verify", "bench", "add"):
        assert f"\n  {name} " in users
    assert [line.split()[0] for line in developers.splitlines()] == ["test", "check"]


def test_arguments_of_test_go_to_pytest_in_the_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[tuple[object, ...]] = []

    def noted(root: Path, words: list[str]) -> int:
        called.append((root, *words))
        return 3

    monkeypatch.setattr(kernel_compilation, "compile_kernels", lambda: None)
    monkeypatch.setattr(development, "run_suite", noted)
    assert acrc("test", "tests/run", "-k", "one", "-q", cwd=tmp_path)[0] == 3
    assert called == [(ROOT, "tests/run", "-k", "one", "-q")]


def test_every_check_runs_and_the_failed_ones_are_named(capfd: pytest.CaptureFixture[str]) -> None:
    good = Check("good", ("-c", "print('fine')"))
    bad = Check("bad", ("-c", "raise SystemExit(3)"))
    output = io.StringIO()
    assert not run_checks(ROOT, Console(file=output), (bad, good, bad))
    assert output.getvalue().splitlines()[-1] == "2 of 3 checks failed: bad, bad"
    assert capfd.readouterr().out == "fine\n"
    output = io.StringIO()
    assert run_checks(ROOT, Console(file=output), (good,))
    assert output.getvalue().splitlines()[-1] == "all 1 checks passed: good"


NEAR = PoseError(3, 0.04, 0.1, 0.0, 0.0, 0, False)
ASTRAY = PoseError(1, 1.0, 1.234, 1.0, 1.0, 1, True)


def robot(
    total: int, done: int, completion_s: float | None = None, error: PoseError = NEAR, **further: Value
) -> RobotResult:
    task = {"places_total": total, "places_done": done, "completion_s": completion_s, **further}
    return RobotResult(task, error)


RESULT = RunResult(
    digest="d0d0", robots=2, seed=1, simulated_s=600.0, wall_s=12.345, startup_s=0.9, cpu_s=20.0,
    real_time_factor=48.6, task={"places_total": 4, "places_done": 3, "completion_s": None},
    task_summary="cleaned 3 of 4 places in 600 s of simulated time; 1 is left",
    declaration=CleaningTask.declaration, radio_bytes_per_robot_s=0.25,
    per_robot={"r1": robot(2, 2, 311.25), "r2": robot(2, 1, error=ASTRAY)},
    deeco=DeecoResult({}, {}, None, None),
    navigation=NavigationResult(7, 3, {"blocked": 2, "no plan": 0, "no progress": 1}, 4, 0, {}, 9.5),
    undelivered=0, unread=0, contacts=5, refused_orders=(), isolation="full", bus="zenoh", out="/o",
    frames={"frames_sent": 10, "frames_cut_off": 0, "copies_heard": 7},
)  # fmt: skip


def test_a_result_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    summary.print_result(RESULT, json=False)
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert lines[-8:] == [
        "2 robots cleaned 3 of 4 places in 600 s of simulated time; 1 is left.",
        "Wall time: 12.3 s (48.6 times faster than real time), after 0.9 s of start-up.",
        "Radio: 10 frames sent; at other robots: 7 received, 0 lost.",
        "Bumper contacts: 5.",
        "Localisation error: RMSE 0.50 m, maximum 1.23 m; robots lost their position once.",
        "Navigation: 7 goals, 3 aborted (2 blocked, 1 no progress).",
        "Digest: d0d0",
        "Recordings: /o",
    ]
    assert cells(lines) == [
        ["r1", "2 of 2", "311.2 s"], ["r2", "1 of 2", "not finished"], ["all", "3 of 4", "not finished"]
    ]  # fmt: skip


def cells(lines: list[str]) -> list[list[str]]:
    rows = [line.strip("│ ").split("│") for line in lines if "│" in line]
    return [[cell.strip() for cell in row] for row in rows]


def test_columns_and_notes_of_the_task_are_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    some = msgspec.structs.replace(
        RESULT, task={"places_total": 9, "places_done": 3, "places_given_up": 3},
        task_summary="did much", task_notes=("One sentence.", "\033[31mAnother."),
        per_robot={"r1": robot(2, 2, 311.25, places_given_up=0), "r2": robot(7, 1, places_given_up=3)},
    )  # fmt: skip
    summary.print_result(some, json=False)
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert cells(lines) == [
        ["r1", "2 of 2", "0", "311.2 s"],
        ["r2", "1 of 7", "3", "not finished"],
        ["all", "3 of 9", "3", "not finished"],
    ]  # fmt: skip
    assert lines[-10:-7] == ["2 robots did much.", "One sentence.", "\\x1b[31mAnother."]


def test_frames_lost_are_sentences(capsys: pytest.CaptureFixture[str]) -> None:
    some = msgspec.structs.replace(
        RESULT, task_summary="won", unread=1, origin=Origin(strategy="chapter"), contacts=0,
        direct_reach=0.65,
        frames={
            "frames_sent": 10, "frames_refused": 2, "frames_overflowed": 1, "copies_heard": 7,
            "copies_lost_collision": 1, "copies_lost_below_sensitivity": 4, "events_dropped": 1,
        },
    )  # fmt: skip
    summary.print_result(some, json=False)
    said = capsys.readouterr().out
    assert "messages delivered but not read: 1\n" in said
    lines = [line for line in said.splitlines() if "not read" not in line]
    assert lines[-11] == "2 robots with strategy chapter won."
    assert lines[-9:-5] == [
        "Radio: 10 frames sent; at other robots: 7 received, 5 lost (4 below sensitivity, 1 collision).",
        "Radio: 3 frames not sent (2 refused, 1 overflowed).",
        "Radio: events missed by robots: 1 (1 dropped).",
        "Pairs of robots in direct radio range: 65% of the time.",
    ]
    assert lines[-5] == "Bumper contacts: none."


def test_a_result_names_the_next_commands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(REPOSITORY)
    baseline = ["run", "my.toml", "--strategy", "none"]
    summary.print_next_commands(Path("/o/my run"), baseline, [REPOSITORY])
    assert capsys.readouterr().out.splitlines() == [
        "Draw the run: ./acrc view '/o/my run' --png",
        "Open the run in the viewer: ./acrc view '/o/my run'",
        "Show where the robots' time went: ./acrc causes '/o/my run'",
        "List the decisions of r1: ./acrc explain '/o/my run' r1 --modules .",
        "For comparison, run it without adaptation: ./acrc run my.toml --strategy none",
    ]
    summary.print_next_commands(REPOSITORY / "runs" / "a")
    assert capsys.readouterr().out.splitlines() == [
        "Draw the run: ./acrc view runs/a --png",
        "Open the run in the viewer: ./acrc view runs/a",
        "Show where the robots' time went: ./acrc causes runs/a",
        "List the decisions of r1: ./acrc explain runs/a r1",
    ]


@pytest.mark.parametrize(
    ("given", "out", "hint"),
    [
        (("run",), None, "run --strategy none"),
        (("run", "a b.toml", "--seed=3", "--set", "deeco.publish=0.5"), None,
         "run 'a b.toml' --seed=3 --set deeco.publish=0.5 --strategy none"),
        (("run", "--strategy", "swap", "--set", "strategy.reach=1", "--set=strategy.n=2", "--modules", "."),
         None, "run --modules . --strategy none"),
        (("run", "--out", "x"), Path("x"), "run --strategy none --out x-none"),
    ],
)  # fmt: skip
def test_the_command_without_adaptation_keeps_other_options(
    given: tuple[str, ...], out: Path | None, hint: str
) -> None:
    assert shlex.join(run._baseline_arguments(given, out, "none")) == hint


def test_suggested_commands_work_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert usage.command_name() == str(REPOSITORY / "acrc")
    monkeypatch.setattr(usage, "REPOSITORY", tmp_path / "site-packages")
    assert usage.command_name() == "acrc"
    (clone := tmp_path / "my clone").mkdir()
    (clone / "acrc").touch()
    monkeypatch.setattr(usage, "REPOSITORY", clone)
    assert usage.command_name() == f"'{clone}/acrc'"
    monkeypatch.chdir(clone)
    assert usage.command_name() == "./acrc"


def test_a_result_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    summary.print_result(RESULT, json=True)
    assert msgspec.json.decode(capsys.readouterr().out, type=RunResult) == RESULT
