"""docs/architecture.md is true: its rooms are all rooms, its files exist, a run goes its two ways."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from actors.installation import repository
from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

PAGE = (REPOSITORY / "docs" / "architecture.md").read_text()
PACKAGES = tuple(sorted(repository.PACKAGES))
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    *sorted(f"docs/{page.name}" for page in (REPOSITORY / "docs").glob("*.md")),
]
CLASS = r"(?<![\w./:-])([A-Z][a-z]+(?:[A-Z][a-z0-9]*)+|[A-Z][a-z]+(?=\.[a-z]))(?:\.([a-z_]\w*))?"
ELSEWHERE = {
    "AppArmor", "ClearCostmapRecovery", "CostmapModel", "ExecStopPost", "FrameTransforms", "InOut",
    "LaserScan", "MarkerArray", "MemoryMax", "MoveBase", "NamedTuple", "ObstacleCostFunction",
    "OccupancyGrid", "ParamHolder", "PeriodicScheduling", "PointCloud", "PointCloud2", "PoseInFrame",
    "PoseStamped", "PosesInFrame", "SceneUpdate", "SimpleTrajectoryGenerator", "TasksMax",
}  # fmt: skip
"""Names of ROS, Foxglove, JDEECo, systemd, Linux and Python."""
WAYS = ("The way of one scan", "The way of one packet of knowledge")


@cache
def sources() -> list[Path]:
    """Every Python file that git knows of or would take."""
    asked = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py"]
    listed = subprocess.run(asked, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
    return [Path(line) for line in listed.splitlines() if (REPOSITORY / line).is_file()]


@cache
def classes() -> dict[str, set[str]]:
    """The members of each class of ours, those of its bases among them."""
    own: dict[str, set[str]] = {}
    bases: dict[str, list[str]] = {}
    trees = [ast.walk(ast.parse((REPOSITORY / path).read_text())) for path in sources()]
    for node in (node for tree in trees for node in tree if isinstance(node, ast.ClassDef)):
        own.setdefault(node.name, set()).update(member for part in node.body for member in declared(part))
        bases.setdefault(node.name, []).extend(base.id for base in node.bases if isinstance(base, ast.Name))

    def members(name: str) -> set[str]:
        inherited = (members(base) for base in bases.get(name, ()) if base != name)
        return own.get(name, set()).union(*inherited)

    return {name: members(name) for name in own}


def declared(part: ast.stmt) -> list[str]:
    """The names that a statement in the body of a class gives it."""
    if isinstance(part, ast.FunctionDef):
        return [part.name]
    targets = part.targets if isinstance(part, ast.Assign) else [getattr(part, "target", None)]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def coded(text: str) -> str:
    """What stands in backticks and in blocks of code, the classes that a page defines itself left out."""
    blocks = re.findall(r"^```.*?^```", text, re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))
    code = "\n".join((*blocks, *spans))
    for name in re.findall(r"\b(?:class|import) (\w+)", code):
        code = re.sub(rf"\b{name}\b", "", code)
    return code


def section(title: str) -> str:
    """The text below a heading, to the next one."""
    return PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]


def rows(title: str) -> list[list[str]]:
    """The cells of the table below a heading, without its first two lines."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def names(text: str) -> list[str]:
    """What stands in backticks and is no file."""
    return [name for name in re.findall(r"`([^`]+)`", text) if re.fullmatch(r"[A-Za-z_][\w.]*", name)]


def files(text: str) -> list[Path]:
    return [REPOSITORY / name for name in re.findall(r"`([\w/]+\.py)`", text)]


@cache
def defined(path: Path) -> set[str]:
    """Classes, functions and methods of a file, these as `Class.method`."""
    found = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{one.name}" for one in node.body if isinstance(one, ast.FunctionDef)}
    return found


@pytest.mark.parametrize("page", PAGES)
def test_every_module_that_a_page_names_exists(page: str) -> None:
    text = (REPOSITORY / page).read_text()
    packages = "|".join(PACKAGES)
    named = set(re.findall(rf"(?<![\w./-])((?:{packages})/[\w/]+\.py)\b", text))
    assert sorted(name for name in named if not (REPOSITORY / name).is_file()) == []
    dotted = set(re.findall(rf"(?:from|import|python -m) ((?:{packages})(?:\.\w+)+)", text))
    places = {name: REPOSITORY / name.replace(".", "/") for name in dotted}
    assert (
        sorted(n for n, at in places.items() if not at.is_dir() and not at.with_suffix(".py").is_file()) == []
    )


@pytest.mark.parametrize("page", PAGES)
def test_every_class_that_a_page_names_exists(page: str) -> None:
    """In backticks or in a block of code: a class of ours, a member of one, or a name of somebody else."""
    wrong, ours = [], classes()
    for name, member in re.findall(CLASS, coded((REPOSITORY / page).read_text())):
        if name not in ours and name not in ELSEWHERE:
            wrong.append(name)
        elif member and member not in ours.get(name, {member}):
            wrong.append(f"{name}.{member}")
    assert wrong == []


@pytest.mark.parametrize("title", [*WAYS, "Where is …"])
def test_every_name_on_a_way_is_in_a_file_beside_it(title: str) -> None:
    everything = set().union(*(defined(REPOSITORY / path) for path in sources() if path.parts[0] in PACKAGES))
    for cells in rows(title):
        row = " | ".join(cells[1:])
        here = set().union(*(defined(path) for path in files(row)))
        for name in names(row):
            a_class_of_elsewhere = name[0].isupper() and "." not in name and name in everything
            assert name in here or a_class_of_elsewhere, f"{name} in: {row}"


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, str]]:
    """File and name of every function of the project that was called in a few seconds of a run, in order."""
    seen: list[tuple[str, str]] = []
    root = str(REPOSITORY)

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(root):
            seen.append((code.co_filename, code.co_qualname))

    scenario = load_scenario(REPOSITORY / "scenarios" / "chapter.toml", Overrides(robots=2, duration=6.0))
    options = RunOptions(tmp_path_factory.mktemp("walked") / "out", bus="memory", json=True)
    plan = swarm.plan(scenario, options)
    sys.setprofile(note)
    try:
        swarm.run_in_memory(plan, lambda progress: None)
    finally:
        sys.setprofile(None)
    return seen


def walked(title: str) -> Iterator[tuple[str, str]]:
    """Each method named on a way, with its file."""
    for cells in rows(title):
        first, *_ = files(cells[1])
        for name in names(" ".join(cells[2:])):
            if "." in name:
                yield str(first), name


@pytest.mark.parametrize("title", WAYS)
def test_a_run_goes_the_way_that_the_page_tells(title: str, calls: list[tuple[str, str]]) -> None:
    way = list(walked(title))
    assert len(way) > 10
    at = 0
    for step in way:
        later = next((index for index in range(at, len(calls)) if calls[index] == step), None)
        assert later is not None, f"{step[1]} is not called after what stands before it on the page"
        at = later + 1
