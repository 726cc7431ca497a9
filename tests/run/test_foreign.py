"""Only modules that are installed or in folders on the command line are run."""

import hashlib
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.installation.repository import PACKAGES, REPOSITORY
from actors.installation.usage import OptionError
from actors.robot.behaviour.code_permit import INSTALLED, Permit, permit_of, permitted_folders
from actors.runtime.errors import AcrcError
from actors.user_code import FINDER, RecordedModules, expect_hashes, is_installed, module_file, set_folders

SOURCE = Path("bold.toml")
RECORDED, CHANGED, GROWN = "import json\n", "raise AssertionError\n", "from package import more\n"
NOT_IMPORTED = "raise AssertionError('nothing is imported')"


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a strategy, a package and a namespace, outside the working directory."""
    folder = tmp_path / "study"
    (folder / "package").mkdir(parents=True)
    (folder / "namespace").mkdir()
    (folder / "package" / "__init__.py").write_text(NOT_IMPORTED)
    (folder / "namespace" / "strategy.py").write_text(NOT_IMPORTED)
    (folder / "strategy.py").write_text(NOT_IMPORTED)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return folder


@pytest.fixture
def looked() -> Iterator[None]:
    """Restore the search for modules."""
    before = set(sys.modules)
    yield
    set_folders(())
    expect_hashes(None)
    for name in set(sys.modules) - before:
        del sys.modules[name]


def refusal(entry: str, places: list[Path], permit: Permit) -> str:
    with pytest.raises(AcrcError) as caught:
        permitted_folders(SOURCE, entry, places, permit)
    return str(caught.value)


def sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def foreign_sentence(name: str, file: Path, folder: object) -> str:
    return (
        f"bold.toml: strategy {name}: its code {file} is neither installed nor in a "
        f"permitted folder; read it, then add --modules {folder}, or --trust"
    )


@pytest.mark.parametrize(
    ("entry", "file"),
    [
        ("strategy:behaviour", "strategy.py"),
        ("package.deep:behaviour", "package/__init__.py"),
        ("namespace.strategy:behaviour", "namespace/strategy.py"),
        ('cleaning.strategies.none:behaviour>strategy:behaviour{"reach":0.5}@60', "strategy.py"),
    ],
)
def test_foreign_code_is_named(study: Path, entry: str, file: str) -> None:
    name = "strategy:behaviour" if ">" in entry else entry
    assert refusal(entry, [study], INSTALLED) == foreign_sentence(name, study / file, study)
    assert permitted_folders(SOURCE, entry, [study], Permit((study,))) == (study,)
    assert permitted_folders(SOURCE, entry, [study], Permit(trust=True)) == (study,)


def test_a_typed_strategy_is_found_in_the_working_directory_and_admits_no_other(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(study)
    assert refusal("strategy:behaviour", [study], INSTALLED) == foreign_sentence(
        "strategy:behaviour", study / "strategy.py", "."
    )
    typed = Permit(typed="strategy:behaviour")
    assert permitted_folders(SOURCE, "strategy:behaviour", [], typed) == (study,)
    for entry in ("package:evil>strategy:behaviour@3", "strategy:behaviour>package:evil@3"):
        refusal(entry, [], typed)


def test_installed_modules_need_no_folder_and_cannot_be_replaced(study: Path, looked: None) -> None:
    for name in ("json", "numpy", "actors", "cleaning", "tomllib"):
        (study / name).mkdir()
        (study / name / "__init__.py").write_text(NOT_IMPORTED)
    (study / "colorsys.py").write_text(NOT_IMPORTED)
    for entry in ("cleaning.strategies.none:behaviour", "numpy:array", "json.decoder:loads", "sys:exit"):
        assert permitted_folders(SOURCE, entry, [study], INSTALLED) == ()
    assert permitted_folders(SOURCE, "cleaning.strategies.none:behaviour", [study], Permit((study,))) == ()
    sys.modules.pop("colorsys", None)
    set_folders([study])
    import colorsys  # noqa: PLC0415  # what was not imported before is looked for now

    assert not Path(str(colorsys.__file__)).is_relative_to(study)


@pytest.mark.parametrize(
    "entry",
    [
        "cleaning.none_such:behaviour", ":", "..study.strategy:behaviour",
        "../study/strategy:behaviour", "/study/strategy:behaviour", "strategy/:behaviour", "strategy\n:x",
        "a\0b:behaviour", "str ategy:behaviour", "strat\u0435gy:behaviour", "STRATEGY:behaviour",
    ],
)  # fmt: skip
def test_entries_that_name_no_module_are_refused(study: Path, entry: str) -> None:
    refusal(entry, [study, Path("a\0b"), Path("x" * 5000), Path("/dev/null/x")], INSTALLED)


def test_a_missing_module_is_named_with_the_folders_searched(study: Path) -> None:
    assert refusal("no_such_module:behaviour", [study], INSTALLED) == (
        "bold.toml: strategy no_such_module:behaviour: there is no module 'no_such_module' "
        f"here or in {study} and {Path.cwd()}; install it, or name its folder with --modules DIR"
    )


def test_folders_beside_the_packages_are_not_installed() -> None:
    """Pytest and `python -m` have the repository on Python's path, and people unpack things there."""
    assert str(REPOSITORY) in sys.path
    for module in ("tests.run.heir", "examples.courteous", "runs.received.evil", "conftest"):
        assert not is_installed(module)
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    packages = project["tool"]["setuptools"]["packages"]["find"]["include"]
    assert {name.removesuffix("*") for name in packages} == PACKAGES - {"deeco"}, "another distribution"


def test_a_link_to_a_library_is_not_installed(study: Path) -> None:
    """The package's own file is the library's, and its parts are not."""
    library = Path(str(sys.modules["json"].__file__))
    (study / "linked").mkdir()
    (study / "linked" / "__init__.py").symlink_to(library)
    (study / "linked" / "evil.py").write_text(NOT_IMPORTED)
    for permit in (INSTALLED, Permit((study,)), Permit(trust=True)):
        assert refusal("linked.evil:behaviour", [study], permit) == (
            f"{study}/linked/__init__.py: links to {library.resolve()}; copy the code into {study}"
        )


def test_a_folder_for_modules_must_be_a_directory(study: Path) -> None:
    with pytest.raises(OptionError) as caught:
        permit_of([study / "strategy.py"])
    assert (
        str(caught.value)
        == f"--modules: {study}/strategy.py is not a folder; give a folder of Python modules"
    )
    (study.parent / "link").symlink_to(study)
    assert permit_of([study.parent / "link"]) == Permit((study,))


def test_a_module_with_the_name_of_an_installed_one_is_refused(study: Path) -> None:
    (study / "code.py").write_text(NOT_IMPORTED)
    assert refusal("code:behaviour", [], Permit((study,))) == (
        f"bold.toml: strategy code:behaviour: {study}/code.py has the name of the "
        "installed module 'code'; rename your module"
    )
    for package in ("json", "deploy", "random"):
        assert refusal(f"{package}.evil:behaviour", [study], INSTALLED) == (
            f"bold.toml: strategy {package}.evil:behaviour: '{package}' is an installed package "
            f"without such a module; if {package}/ is your own folder, rename it"
        )


def test_bytecode_is_neither_used_nor_written(
    study: Path, looked: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    import py_compile  # noqa: PLC0415

    monkeypatch.setattr("sys.pycache_prefix", None)  # else it would not even be looked for here
    (study / "package" / "__init__.py").write_text("")
    evil = study / "evil.py"
    evil.write_text("WHO = 'bytecode'\n")
    mode = py_compile.PycInvalidationMode.UNCHECKED_HASH
    cached = Path(str(py_compile.compile(str(evil), invalidation_mode=mode)))
    py_compile.compile(str(evil), str(study / "only.pyc"))
    py_compile.compile(str(evil), str(study / "package" / "only.pyc"))
    (study / "package" / "native.so").write_bytes(b"\x7fELF")
    evil.write_text("WHO = 'source'\n")
    set_folders([study])
    from evil import WHO  # type: ignore[import-not-found]  # noqa: PLC0415

    assert WHO == "source" and cached.exists()
    for name in ("only", "package.only", "package.native"):
        with pytest.raises(ModuleNotFoundError):
            __import__(name)
    assert sorted(path.name for path in study.rglob("*.pyc")) == [cached.name, "only.pyc", "only.pyc"]


def test_a_module_that_is_not_a_file_is_missing(study: Path, looked: None) -> None:
    import os  # noqa: PLC0415

    os.mkfifo(study / "pipe.py")
    assert module_file("pipe", study) is None
    (study / "endless.py").symlink_to("/dev/zero")
    assert module_file("endless", study) is None
    (study / "large.py").write_bytes(b"#" * 16_000_001)
    set_folders([study])
    with pytest.raises(OSError, match="has more than 16000000 bytes"):
        __import__("large")


def test_loaded_code_equals_hashed_and_recorded_code(study: Path, looked: None) -> None:
    (study / "mine.py").write_text("from namespace import help\nfrom package import part\n")
    (study / "namespace" / "help.py").write_text("")
    (study / "package" / "__init__.py").write_text("")
    (study / "package" / "part.py").write_text(RECORDED)
    set_folders([study])
    __import__("mine")
    hashes = FINDER.hashes()
    assert list(hashes) == ["mine.py", "namespace/help.py", "package/__init__.py", "package/part.py"]
    for name in ("mine", "namespace", "namespace.help", "package", "package.part"):
        del sys.modules[name]
    expect_hashes(RecordedModules(hashes))
    __import__("mine")
    for name in ("mine", "package", "package.part"):
        del sys.modules[name]
    (study / "package" / "part.py").write_text(CHANGED)
    with pytest.raises(AcrcError) as caught:
        __import__("mine")
    assert str(caught.value) == (
        f"{study}/package/part.py: differs from the file of the recorded run: sha256 {sha256(CHANGED)[:12]}, "
        f"recorded {sha256(RECORDED)[:12]}; --trust loads it anyway"
    )
    (study / "package" / "part.py").write_text(GROWN)
    (study / "package" / "more.py").write_text("")
    grown = hashes | {"package/part.py": sha256(GROWN)}
    expect_hashes(RecordedModules(grown))
    with pytest.raises(AcrcError) as caught:
        __import__("package.part")
    assert str(caught.value) == (
        f"{study}/package/more.py: not loaded by the recorded run; --trust loads it anyway"
    )
    sys.modules.pop("package.part", None)
    expect_hashes(RecordedModules(grown, whole=False))  # it was killed, and may have loaded more
    __import__("package.part")
