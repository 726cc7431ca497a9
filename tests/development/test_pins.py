import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import deeco

ROOT = Path(__file__).parents[2]
OWN = {"deeco"}  # installed from the clone, in its version
LEFT_OUT = {"apsw", "backports-zstd", "lz4", "ruamel-yaml", "zstandard"}


def lines() -> list[str]:
    return (ROOT / "constraints.txt").read_text().replace("\\\n", " ").splitlines()


def sections() -> dict[str, dict[str, Requirement]]:
    """Return the pins of each section for this Python, by canonical package name."""
    found: dict[str, dict[str, Requirement]] = {}
    for line in lines():
        if header := re.fullmatch(r"# \[(\w+)\]", line):
            current = found.setdefault(header[1], {})
        elif line and not line.startswith("#"):
            pin = Requirement(line.partition(" --hash=")[0])
            if pin.marker is None or pin.marker.evaluate():
                assert canonicalize_name(pin.name) not in current, f"{pin.name} is pinned twice"
                current[canonicalize_name(pin.name)] = pin
    return found


def wanted() -> dict[str, list[str]]:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project, needed = settings["project"], settings["build-system"]["requires"]
    return {"build": needed, "base": project["dependencies"], **project["optional-dependencies"]}


def closure(names: list[str]) -> set[str]:
    """Return these packages and all their installed dependencies."""
    todo, seen = [canonicalize_name(Requirement(name).name) for name in names], set[str]()
    while todo:
        name = todo.pop()
        if name in seen or name in LEFT_OUT:
            continue
        seen.add(name)
        for text in metadata.requires(name) or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                todo.append(canonicalize_name(requirement.name))
    return seen - OWN


def skip_if_left_out(extra: str) -> None:
    """Skip if `extra` is `observe`, which `acrc test` does not install, and is not installed."""
    if extra == "observe":
        pytest.importorskip("rerun")


def test_the_sections_are_the_extras() -> None:
    assert list(sections()) == list(wanted())
    assert [str(pin) for pin in sections()["build"].values()] == wanted()["build"]


def test_every_pin_has_the_hashes_of_its_files() -> None:
    """Check hashes for Linux on x86-64 and ARM, without duplicates."""
    seen: dict[str, str] = {}
    for line in lines():
        if not line or line.startswith("#"):
            continue
        pin, *options = line.split(" --hash=")
        hashes = [option.strip() for option in options]
        assert hashes and all(re.fullmatch("sha256:[0-9a-f]{64}", one) for one in hashes), pin
        assert hashes == sorted(set(hashes)), pin
        for one in hashes:
            assert seen.setdefault(one, pin.strip()) == pin.strip(), f"{pin} has a hash of {seen[one]}"


@pytest.mark.parametrize("extra", [name for name in wanted() if name != "build"])
def test_the_pins_of_an_extra_are_its_dependencies_and_nothing_else(extra: str) -> None:
    skip_if_left_out(extra)
    base, own = set(sections()["base"]), set(sections()[extra])
    needed = closure(wanted()[extra])
    assert needed - base - own == set()
    assert own - needed == set()


def test_every_pin_is_exact_and_installed_and_satisfies_the_others() -> None:
    skip_if_left_out("observe")
    for extra, section in sections().items():
        for name, pin in section.items():
            (exact,) = pin.specifier
            assert exact.operator == "=="
            # build requirements are installed in a temporary folder
            assert extra == "build" or (name, exact.version) == (name, metadata.version(name))
    pins = {name: pin for section in sections().values() for name, pin in section.items()}
    for name in set(pins) - set(sections()["build"]):
        for text in metadata.requires(name) or []:
            requirement = Requirement(text)
            other = pins.get(canonicalize_name(requirement.name))
            applies = requirement.marker is None or requirement.marker.evaluate({"extra": ""})
            if applies and other is not None:
                (exact,) = other.specifier
                assert requirement.specifier.contains(exact.version, prereleases=True), f"{name}: {text}"


def test_the_testbed_accepts_the_component_model_of_its_clone() -> None:
    component_model = tomllib.loads((ROOT / "distributions/deeco/pyproject.toml").read_text())
    project = component_model["project"]
    (required,) = (one for one in map(Requirement, wanted()["base"]) if one.name in OWN)
    assert {one.operator for one in required.specifier} == {">=", "<"}
    assert required.specifier.contains(project["version"])
    assert project["version"] == deeco.__version__ == metadata.version("deeco")
    testbed = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["requires-python"] == testbed["project"]["requires-python"]
    assert component_model["build-system"] == testbed["build-system"], (
        "both are built with the pinned version"
    )


def test_no_file_contains_a_download_location() -> None:
    files = ("acrc", "constraints.txt", "pyproject.toml", "distributions/deeco/pyproject.toml", ".ci/run")
    text = "".join((ROOT / name).read_text() for name in files)
    assert not re.search(r"https?://|--(extra-)?index-url|--find-links", text)


@pytest.mark.parametrize("extra", [name for name in sections() if name != "build"])
def test_the_script_estimates_the_size_of_an_extra(extra: str) -> None:
    """Allow 25 % (wheels differ between machines) or 5 MB."""
    skip_if_left_out(extra)
    script = (ROOT / "acrc").read_text()
    estimated = re.search(
        r"total=(\d+)\n" if extra == "base" else rf"{extra}\) total=\$\(\(total \+ (\d+)\)\)", script
    )
    assert estimated is not None
    files = [
        Path(str(file.locate())) for name in sections()[extra] for file in metadata.files(name) or () if file
    ]
    true = sum(file.stat().st_size for file in files if file.is_file()) / 1e6
    assert abs(true - int(estimated[1])) < max(5.0, 0.25 * true)


def test_the_citation_matches_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (cited["version"], cited["license"]) == (project["version"], project["license"])
