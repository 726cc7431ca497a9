"""Code that the user has neither written nor installed is named to him, and does not run without his word."""

from pathlib import Path

import pytest

from deploy.run import foreign, swarm
from deploy.run.foreign import ForeignCodeError
from tests.scenario.faults import scenario


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a strategy, a package and a namespace, and another one in which the user stands."""
    folder = tmp_path / "study"
    (folder / "package").mkdir(parents=True)
    (folder / "namespace").mkdir()
    (folder / "package" / "__init__.py").write_text("raise AssertionError('nothing is imported')")
    (folder / "namespace" / "strategy.py").write_text("raise AssertionError('nothing is imported')")
    (folder / "strategy.py").write_text("raise AssertionError('nothing is imported')")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return folder


@pytest.mark.parametrize(
    ("entry", "file"),
    [
        ("strategy:behaviour", "strategy.py"),
        ("package.deep:behaviour", "package/__init__.py"),
        ("namespace.strategy:behaviour", "namespace"),
    ],
)
def test_code_from_elsewhere_is_named(study: Path, entry: str, file: str) -> None:
    with pytest.raises(ForeignCodeError) as caught:
        foreign.refuse_foreign(Path("bold.toml"), entry, [study])
    assert str(caught.value) == (
        f"bold.toml runs code from {study / file}, which is neither this project's nor installed nor below "
        "the folder where you stand; read it, and say --trust if it may run"
    )


def test_ours_what_is_installed_and_what_lies_where_one_stands_is_not_foreign(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for entry in (
        "cleaning.strategies.none:behaviour",
        "numpy:array",
        "json:loads",
        "no_such_module:behaviour",
        ":",
    ):
        foreign.refuse_foreign(Path("x.toml"), entry, [study])
    monkeypatch.chdir(study)
    foreign.refuse_foreign(Path("x.toml"), "strategy:behaviour", [study])


def test_a_path_that_no_file_has_leads_nowhere() -> None:
    assert foreign.found("strategy:behaviour", [Path("a\0b"), Path("x" * 5000)]) is None
    assert foreign.folder_of("strategy:behaviour", [Path("a\0b"), Path("/dev/null/x")]) is None


def test_a_module_that_takes_the_place_of_ours_is_foreign(study: Path) -> None:
    (study / "cleaning").mkdir()
    (study / "cleaning" / "__init__.py").write_text("")
    with pytest.raises(ForeignCodeError):
        foreign.refuse_foreign(Path("x.toml"), "cleaning.strategies.none:behaviour", [study])


def test_nothing_beside_a_scenario_can_take_a_librarys_place(study: Path) -> None:
    (study / "statistics.py").write_text("raise AssertionError('nothing is imported')")
    chosen = scenario(f'[run]\nmodules = "{study}"\n')
    assert swarm.module_folders("cleaning.strategies.none:behaviour", chosen) == ()
    assert swarm.module_folders("strategy:behaviour", chosen) == (study, Path.cwd())
