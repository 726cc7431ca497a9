"""Pages of the documentation: links, command names and settings are right; nightly, code blocks run."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Final, NamedTuple

import msgspec
import pytest

import actors.robot.behaviour as robot
import deeco
from acrc_testbed.command_line import documentation
from acrc_testbed.experiments.metrics import task_metrics
from acrc_testbed.experiments.study import load_study
from acrc_testbed.explanation.time_spent import Cause
from actors.installation.repository import REPOSITORY
from actors.observer.glyphs import ACTIVITY_GLYPHS, CAUSE_GLYPHS
from actors.robot.introspector import ACTIVITIES
from actors.task.loading import load_task
from actors.user_code import set_task_folders
from deploy.scenario.scenario_file import parse
from tests import warm
from tests.documentation.markdown import Block, MarkdownPage, pages
from tests.in_process import acrc
from tests.localisation import courses

PAGES = {page.name: page for page in pages()}
TREE = documentation.command_tree()
LANGUAGES = {"sh", "python", "toml", "yaml", "text", "mermaid", "{eval-rst}", "{toctree}"}
IN_A_CLONE = ("scenarios", "studies", "maps", "examples", "fleets")
PLACEHOLDERS = {"…", "...", "COMMAND", "X"}
LEAST = {
    "map": 'map = "maps/corridor.yaml"',
    "run": '[run]\nduration = 60.0\nstrategy = "none"',
    "robots": "[robots]\ncount = 1",
    "places": '[places]\npreset = "golden"',
}
"""Required parts of a scenario, by key; the first one is not a table."""


NOT_RUN: Final[Mapping[str, str]] = MappingProxyType({
    r"(apptainer|docker|kubectl|sbatch|sed|tar|deploy/clusters/ssh\.sh) ": "needs another program or host",
    r"(ROS_DOMAIN_ID=0|export|ros2|sudo) ": "runs on a robot with ROS 2",
    r"python -m pip|\./acrc (add|fleet bundle) ": "needs a network",
    r"\S*acrc (cluster|.*tls://HOST)": "needs a cluster",
    r"\S*acrc fleet (doctor|onboard|radio|units .* --robot r2$)": "needs a robot",
    r"\./acrc (view \S+$|.* (--view|--control|--screenshot|--pdb|--debug)\b)": "interactive",
    r"\./acrc (check|test|verify)( (tests|my_study)/\S+| \w+ --full)?$": "runs the tests",
    r"\./acrc (order|run .* --speed 1 )": "needs a second terminal",
    r"\./acrc campaign (--preset chapter --out|study\.toml|studies/)": "takes long",
    r"\./acrc (bundle|compare|report|study plan) .*/"
    r"(adversaries|all|drawn|fig710|four|head|log|offices|people|pilot)\w*\b": "needs trials",
    r"\./acrc (report runs/2026|replay downloaded_run|run my_study/own\.toml|study freeze )": "needs files",
    r"\.venv/bin/python maps/draw_floors\.py": "called by tests/floor/test_offices.py",
})  # fmt: skip
"""Reasons why no test runs a command of a page, by the start of the command."""

SHORTENED: Final[MappingProxyType[str, str]] = MappingProxyType({
    "./acrc run": "--duration 5",
    "./acrc run --seed 3": "--duration 5",
    "./acrc run --robots 8 --seed 3 --duration 300": "--duration 5",
    "./acrc run --bus memory --json": "--duration 5",
    "./acrc run --strategy nearest:behaviour --navigation robust --out runs/nearest": "--duration 5",
    "./acrc run scenarios/head_on.toml --strategy chapter --json": "--duration 5",
    "./acrc run scenarios/head_on.toml --hardware-in-the-loop": "--duration 2",
    "./acrc run scenarios/head_on.toml --hardware-in-the-loop --out runs/trial": "--duration 2",
    "./acrc run scenarios/head_on.toml --bus memory --out runs/model": "--duration 5",
    "./acrc run scenarios/chapter.toml --seed 42 --out runs/chapter": "--duration 5",
    "./acrc run scenarios/head_on.toml --strategy examples.courteous:behaviour --check": "--duration 5",
    "./acrc run scenarios/head_on.toml --out runs/seen": "--duration 20",
    "./acrc run scenarios/head_on.toml --robots 3 --out runs/seen": "--duration 20",
    "./acrc run scenarios/head_on.toml --strategy chapter --out runs/tables": "--duration 5",
    "./acrc run scenarios/people.toml --duration 60 --bus memory --out runs/people": "--duration 5",
    "./acrc campaign --preset chapter": "--robots 2 --seeds 1 --duration 2",
    "./acrc campaign my_study/standing.toml --modules my_study --out campaigns/standing":
        "--robots 2 --seeds 2 --duration 2",
    "./acrc campaign --strategies none,chapter --seeds 40 --out campaigns/chapter":
        "--robots 2 --seeds 2 --duration 2",
    ".venv/bin/python -m tests.localisation.courses course.zip --seed 7": "--duration 9",
    "./acrc verify localisation --from course.zip --runs 20": "--runs 1",
    "./acrc verify localisation --from logs/ --against theirs.json --runs 10": "--runs 1",
})  # fmt: skip
"""Options that shorten a command, by command."""

TESTED_ELSEWHERE: Final[MappingProxyType[tuple[str, str], str]] = MappingProxyType({
    ("docs/tutorial.md", "sh"): "tests/cli/test_tutorial.py",
    ("docs/tutorial.md", "python"): "tests/cli/test_tutorial.py",
    ("docs/authors.md", "python"): "tests/documentation/test_authors.py",
    ("docs/deeco.md", "python"): "tests/deeco/test_programs.py",
    ("docs/library.md", "python"): "tests/library/test_library.py",
    ("docs/tables.md", "python"): "tests/recordings/test_export.py",
    ("docs/clusters.md", "python"): "tests/clusters/test_clusters.py",
    ("docs/clusters.md", "yaml"): "tests/experiments/test_cluster.py",
    ("docs/localisation-log.md", "python"): "tests/localisation/test_logs.py",
})  # fmt: skip
"""Tests of the code blocks of a language on a page."""


class Command(NamedTuple):
    """A command on a page."""

    words: str
    """Without the comment."""
    is_run: bool
    """False: matches `NOT_RUN`."""


def commands_of(block: Block) -> list[Command]:
    """Return the commands of a block in `sh`, one per line."""
    lines = (line.partition(" #")[0].strip() for line in block.text.replace("\\\n", " ").splitlines())
    typed = [line for line in lines if shlex.split(line, comments=True)]
    return [Command(line, not any(re.match(pattern, line) for pattern in NOT_RUN)) for line in typed]


def shortened(command: Command) -> str:
    """Return the command as the tests run it."""
    return f"{command.words} {SHORTENED.get(command.words, '')}".rstrip()


def blocks(language: str) -> list[tuple[str, Block]]:
    """Return page and block for each block of a language."""
    return [(name, one) for name, page in PAGES.items() for one in page.blocks() if one.language == language]


def test_local_links_lead_to_files_and_headings() -> None:
    wrong = []
    for page in PAGES.values():
        for link in (one for one in page.links() if one.is_local):
            file, _, anchor = link.target.partition("#")
            path = (page.path.parent / file).resolve() if file else page.path
            missing = not path.exists() or not path.is_relative_to(REPOSITORY)
            if missing or (anchor and anchor not in MarkdownPage(path).anchors()):
                wrong.append(f"{page.name}: {link.target}")
    assert wrong == []


def test_every_block_has_a_known_language() -> None:
    found = {(name, block.language) for name, page in PAGES.items() for block in page.blocks()}
    assert [one for one in found if one[1] not in LANGUAGES] == []


def unknown_words(text: str) -> str:
    """Return the fault in the words of a command, or ""."""
    words, command, called = shlex.split(text, comments=True)[1:], TREE["acrc"], "acrc"
    while hasattr(command, "commands") and words and words[0] not in PLACEHOLDERS and words[0][0] != "-":
        called = f"{called} {words.pop(0)}"
        if called not in TREE:
            return f"{called} is not a command"
        command = TREE[called]
    if command.context_settings.get("ignore_unknown_options") or command.name == "test":
        return ""
    known = {option for one in command.params for option in (*one.opts, *one.secondary_opts)} | {"--help"}
    options = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    wrong = [option for option in options if option not in known]
    return f"{called} has no {', '.join(wrong)}" if wrong else ""


def test_commands_and_options_on_pages_exist() -> None:
    wrong = []
    for name, page in PAGES.items():
        typed = [one.words for _, block in blocks("sh") if _ == name for one in commands_of(block)]
        wrong += [
            f"{name}: {words}: {fault}"
            for words in (*page.codes(), *typed)
            if re.match(r"(\./)?acrc( |$)", words) and (fault := unknown_words(words))
        ]
    assert wrong == []
    assert unknown_words("./acrc run --colour red") == "acrc run has no --colour"
    assert unknown_words("acrc record everything") == "acrc record everything is not a command"


def test_settings_on_pages_are_valid(tmp_path: Path) -> None:
    for name in IN_A_CLONE:
        (tmp_path / name).symlink_to(REPOSITORY / name)
    write_files(tmp_path, "docs/your-problem.md")
    set_task_folders([tmp_path / "my_problem"])
    (tmp_path / "my_study").mkdir()
    for _, block in blocks("toml"):
        found = tomllib.loads(block.text)
        file = tmp_path / (block.text.split()[1] if block.text.startswith("# my_") else "study.toml")
        if "strategies" in found:
            file.write_text(block.text)
            assert load_study(file).trials()
            continue
        if file.parent.name == "my_problem":
            assert parse(block.text, file).task.use == "rendezvous:Rendezvous"
            continue
        before, *behind = (given if key not in found else "" for key, given in LEAST.items())
        parse("\n".join((before, block.text, *behind)), tmp_path / "scenario.toml")


@pytest.fixture(autouse=True)
def no_task_folders() -> Iterator[None]:
    yield
    set_task_folders(())


def write_files(folder: Path, *names: str) -> None:
    """Write the files of these pages, whose blocks begin with a path."""
    for block in (one for name in names for one in PAGES[name].blocks()):
        if block.text.startswith("# my_"):
            file = folder / block.text.split()[1]
            file.parent.mkdir(exist_ok=True)
            file.write_text(block.text)


def test_the_own_problem_is_solved_by_its_strategy(tmp_path: Path) -> None:
    write_files(tmp_path, "docs/your-problem.md")
    (tmp_path / "maps").symlink_to(REPOSITORY / "maps")
    for strategy, state in (("together", "met after"), ("apart", "are within")):
        words = ("run", "my_problem/rendezvous.toml", "--modules", "my_problem", "--bus", "memory")
        done = acrc(*words, "--strategy", f"rendezvous:{strategy}", "--out", f"runs/{strategy}", cwd=tmp_path)
        assert state in done.stdout, done.stderr


def test_commands_reference_is_current() -> None:
    page = REPOSITORY / "docs" / "reference" / "commands.md"
    assert page.read_text() == documentation.commands_page(), "`./acrc docs` regenerates it"
    (option,) = (one for one in TREE["acrc compare"].params if "--metric" in one.opts)
    words = re.findall(r"\w+", option.help.partition(";")[2].partition(";")[0])
    assert {*words, "places", "settled", "completion"} == {*task_metrics(load_task("cleaning").declaration)}


def defined(title: str) -> list[str]:
    """Return the words that the table below a heading of docs/concepts.md defines, in order."""
    section = PAGES["docs/concepts.md"].text.partition(f"## {title}\n")[2].partition("\n## ")[0]
    return re.findall(r"^\| `([^`]+)`", section, re.MULTILINE)


def test_concepts_define_the_words_of_the_product_once() -> None:
    assert defined("Causes") == [cause.value for cause in Cause]
    assert set(CAUSE_GLYPHS) == set(defined("Causes"))
    assert sorted(defined("What a robot does")) == sorted(ACTIVITIES)
    assert set(ACTIVITIES) < set(ACTIVITY_GLYPHS)
    cells = re.findall(r"^\| (\*[^|]+)", PAGES["docs/concepts.md"].text, re.MULTILINE)
    counted = Counter(word for cell in cells for word in re.findall(r"\*([^*]+)\*", cell))
    assert len(counted) > 40 and max(counted.values()) == 1


@pytest.fixture
def clone() -> Iterator[Path]:
    """Create a folder with the files of a clone and those that the pages require."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:  # a short path, for sockets
        folder = Path(name)
        for given in IN_A_CLONE:
            shutil.copytree(REPOSITORY / given, folder / given)
        (folder / "actors").mkdir()
        (folder / "actors" / "models").symlink_to(REPOSITORY / "actors" / "models")
        (folder / "my_study").mkdir()
        lease = "from cleaning.strategies.chapter import behaviour as behaviour\n"
        (folder / "my_study" / "lease.py").write_text(lease)
        write_files(folder, "docs/experiments.md", "docs/your-problem.md")
        (nearest,) = (block.text for block in PAGES["README.md"].blocks() if block.language == "python")
        (folder / "nearest.py").write_text(nearest)
        yield folder


def type_in(clone: Path, command: str, timeout_s: float = 280.0) -> None:
    """Run a command, which must succeed."""
    runs = [file.parent for file in (clone / "runs").glob("*/scenario.toml")]
    newest = max(runs, key=lambda path: path.stat().st_mtime, default=None)
    program, *words = shlex.split(command.replace("runs/NAME", str(newest)))
    env = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "200"}
    if program == "./acrc":
        done = warm.run(words, clone, env, timeout_s, finds_cwd=False)
    else:
        assert program in {".venv/bin/python", "openssl"}, command
        done = subprocess.run(
            [program.replace(".venv/bin/python", sys.executable), *words], cwd=clone, env=env,
            capture_output=True, text=True, timeout=timeout_s, check=False,
        )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"


def commands_to_run(name: str) -> list[Command]:
    """Return the commands of a page that no other test runs."""
    if (name, "sh") in TESTED_ELSEWHERE:
        return []
    found = [one for page, block in blocks("sh") if page == name for one in commands_of(block)]
    return [one for one in found if one.is_run and one.words != "./acrc demo"]


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", [name for name in PAGES if commands_to_run(name)])
def test_the_commands_of_a_page_run(name: str, clone: Path) -> None:
    if name == "docs/localisation-log.md":
        (clone / "logs").mkdir()
        courses.write_log(clone / "logs" / "course.zip", courses.drive(courses.Setup(seconds=20.0)))
        theirs = [{"log": "course", "runs": [{"rmse": 0.05, "lost": False}, {"rmse": 0.04, "lost": False}]}]
        (clone / "theirs.json").write_bytes(msgspec.json.encode(theirs))
    if name == "docs/experiments.md":
        type_in(clone, "./acrc run scenarios/head_on.toml --bus memory --duration 5")
    for command in commands_to_run(name):
        type_in(clone, shortened(command))


@pytest.mark.nightly
def test_python_on_pages_runs(clone: Path) -> None:
    for name, block in blocks("python"):
        if (name, "python") not in TESTED_ELSEWHERE:
            (clone / "block.py").write_text(block.text)
            type_in(clone, ".venv/bin/python block.py", 60.0)


def test_lists_of_special_commands_name_commands_on_pages() -> None:
    typed = {one.words for _, block in blocks("sh") for one in commands_of(block)}
    assert sorted(set(SHORTENED) - typed) == []
    assert [pattern for pattern in NOT_RUN if not any(re.match(pattern, words) for words in typed)] == []
    for (page, _), test in TESTED_ELSEWHERE.items():
        assert page.rpartition("/")[2] in (REPOSITORY / test).read_text(), f"{test} does not read {page}"


OUTSIDE = re.compile(
    r"""<(?:script|img|iframe|source|audio|video)\b[^>]*?\bsrc=["'](?:https?:)?//"""
    r"""|<link\b[^>]*?\bhref=["'](?:https?:)?//|@import|url\(\s*["']?(?:https?:)?//"""
)
"""References that a browser fetches from other hosts."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site; warnings of Sphinx, such as a page in no table of contents, are errors."""
    return documentation.build(REPOSITORY / "docs", tmp_path_factory.mktemp("docs") / "site").parent


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:.*MystReferenceResolver.app")
def test_every_page_is_there_and_leads_to_files_of_the_site(site: Path) -> None:
    names = {page.name.removesuffix(".md") for page in pages() if page.name.startswith("docs/")}
    assert {name for name in names if not (site / f"{name.removeprefix('docs/')}.html").is_file()} == set()
    missing = []
    for page in site.rglob("*.html"):
        for target in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:", target) and not (page.parent / target).exists():
                missing.append(f"{page.relative_to(site)}: {target}")
    assert missing == []


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:.*MystReferenceResolver.app")
def test_no_page_fetches_anything_from_elsewhere(site: Path) -> None:
    files = [path for path in site.rglob("*") if path.suffix in {".html", ".css", ".js", ".svg"}]
    assert len(files) > sum(name.startswith("docs/") for name in PAGES) > 20, "pages and their scripts"
    assert [str(path) for path in files if OUTSIDE.search(path.read_text(encoding="utf-8"))] == []


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:.*MystReferenceResolver.app")
@pytest.mark.parametrize(("package", "name"), [(robot, "robot"), (deeco, "deeco")])
def test_every_public_name_is_in_the_reference(package: ModuleType, name: str, site: Path) -> None:
    page = (site / "reference" / f"{name}.html").read_text(encoding="utf-8")
    page = re.sub(r"<[^>]+>", "", page)
    assert [one for one in package.__all__ if f"{package.__name__}.{one}" not in page] == []
