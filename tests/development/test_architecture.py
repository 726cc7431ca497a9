"""Files, modules and classes that the documentation names exist."""

import ast
import re
from functools import cache

from actors.installation import repository
from actors.installation.repository import REPOSITORY
from tests.development.budget import class_definitions, committed

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
    "PoseStamped", "PoseWithCovarianceStamped", "PosesInFrame", "SceneUpdate", "SimpleTrajectoryGenerator",
    "TasksMax",
}  # fmt: skip
"""Names of ROS, Foxglove, JDEECo, systemd, Linux and Python."""


@cache
def classes() -> dict[str, set[str]]:
    """Return the members of each class of this project, including those of its bases."""
    own: dict[str, set[str]] = {}
    bases: dict[str, list[str]] = {}
    sources = ((REPOSITORY / path).read_text("utf-8") for path in committed("*.py"))
    for node in (node for source in sources for node in class_definitions(source)):
        own.setdefault(node.name, set()).update(member for part in node.body for member in declared(part))
        bases.setdefault(node.name, []).extend(base.id for base in node.bases if isinstance(base, ast.Name))

    def members(name: str) -> set[str]:
        inherited = (members(base) for base in bases.get(name, ()) if base != name)
        return own.get(name, set()).union(*inherited)

    return {name: members(name) for name in own}


def declared(part: ast.stmt) -> list[str]:
    """Return the names that a statement in a class body defines."""
    if isinstance(part, ast.FunctionDef):
        return [part.name]
    targets = part.targets if isinstance(part, ast.Assign) else [getattr(part, "target", None)]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def coded(text: str) -> str:
    """Return inline code and code blocks, without classes that the page defines."""
    blocks = re.findall(r"^```.*?^```", text, re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))
    code = "\n".join((*blocks, *spans))
    for name in re.findall(r"\b(?:class|import) (\w+)", code):
        code = re.sub(rf"\b{name}\b", "", code)
    return code


def test_modules_on_pages_exist() -> None:
    packages, wrong = "|".join(PACKAGES), []
    for page in PAGES:
        text = (REPOSITORY / page).read_text()
        named = re.findall(rf"(?<![\w./-])((?:{packages})/[\w/]+\.py)\b", text)
        dotted = re.findall(rf"(?:from|import|python -m) ((?:{packages})(?:\.\w+)+)", text)
        paths = {name: REPOSITORY / name.replace(".", "/") for name in dotted}
        wrong += [f"{page}: {name}" for name in named if not (REPOSITORY / name).is_file()]
        wrong += [
            f"{page}: {name}"
            for name, path in paths.items()
            if not path.is_dir() and not path.with_suffix(".py").is_file()
        ]
    assert wrong == []


def test_classes_on_pages_exist() -> None:
    """Check classes in inline code and code blocks: they are of this project, or in ELSEWHERE."""
    wrong, ours = [], classes()
    for page in PAGES:
        for name, member in re.findall(CLASS, coded((REPOSITORY / page).read_text())):
            if name not in ours and name not in ELSEWHERE:
                wrong.append(f"{page}: {name}")
            elif member and member not in ours.get(name, {member}):
                wrong.append(f"{page}: {name}.{member}")
    assert wrong == []


def test_the_architecture_lists_every_folder_and_fits_on_two_pages() -> None:
    page = (REPOSITORY / "docs" / "architecture.md").read_text()
    folders = {file.parent.as_posix() for file in committed("*.py") if file.parts[0] in PACKAGES}
    assert {folder.rstrip("/") for folder in re.findall(r"`([\w/]+/)`", page)} == {*folders, "tests"}
    assert len(page.splitlines()) <= 120


def test_functions_of_the_architecture_are_in_the_files_beside_them() -> None:
    """Check pairs "`file`: `symbol`" and "`symbol`, `file`"."""
    page = (REPOSITORY / "docs" / "architecture.md").read_text()
    pairs = re.findall(r"`(\w+/[\w/]+\.py)`: `([\w.]+)`", page)
    pairs += [(file, symbol) for symbol, file in re.findall(r"`([\w.]+)`, `(\w+/[\w/]+\.py)`", page)]
    missing = [
        f"{file}: {symbol}"
        for file, symbol in pairs
        for name in symbol.split(".")
        if not re.search(
            rf"\b(?:def|class) {name}\b|^{name}\b.*=", (REPOSITORY / file).read_text(), re.MULTILINE
        )
    ]
    assert len(pairs) > 30
    assert missing == []
