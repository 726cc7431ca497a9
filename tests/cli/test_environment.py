"""Commands in users' environments: a sourced ROS, conda, optimised Python, unusual folders and encodings."""

import json
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import load_scenario
from tests import in_process

FOREIGN = ("numpy", "yaml", "zenoh", "msgpack", "typer", "rich")
RUN = ("run", "--bus", "memory", "--robots", "1", "--duration", "1", "--json")


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create packages of a sourced ROS for another Python, and modules that Python imports at start."""
    folder = tmp_path_factory.mktemp("ros")
    for name in FOREIGN:
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("raise ImportError('for another Python')\n")
    for name in ("sitecustomize", "usercustomize", "typing_extensions", "launch_testing"):
        (folder / f"{name}.py").write_text("raise SystemExit('foreign code ran')\n")
    return folder


def acrc(folder: Path, settings: Mapping[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [REPOSITORY / "acrc", *words],
        check=False, cwd=folder, env={**os.environ, **settings}, capture_output=True, text=True, timeout=100,
    )  # fmt: skip


def test_variables_of_another_environment_change_nothing(ros: Path, tmp_path: Path) -> None:
    """Run once with all variables: any effect would fail the run."""
    settings = {
        "PYTHONPATH": str(ros), "PYTHONHOME": "/usr", "PYTHONOPTIMIZE": "2", "PYTHONWARNINGS": "error",
        "PYTHONDEVMODE": "1", "PYTHONSAFEPATH": "", "PYTHONNOUSERSITE": "1", "PYTHONUSERBASE": str(ros),
        "PYTHONINSPECT": "1", "PYTHONHASHSEED": "no number", "PYTHONIOENCODING": "ascii", "LC_ALL": "C",
        "PYTHONPYCACHEPREFIX": "/nowhere", "PYTHONDONTWRITEBYTECODE": "1", "CONDA_PREFIX": str(ros),
        "VIRTUAL_ENV": str(ros), "PATH": f"{ros}:{os.environ['PATH']}",
        "HOME": "/nowhere", "TMPDIR": "/nowhere", "ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": "/opt/ros",
    }  # fmt: skip
    (ros / "python3").write_text("#!/bin/sh\nexit 3\n")
    (ros / "python3").chmod(0o755)
    done = acrc(tmp_path, settings, *RUN)
    assert (done.returncode, done.stderr) == (0, "")
    here = in_process.acrc(*RUN, cwd=tmp_path).stdout
    assert json.loads(done.stdout)["digest"] == json.loads(here)["digest"]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-8", "utf-16"])
def test_a_scenario_from_an_editor_on_windows(encoding: str, tmp_path: Path) -> None:
    shipped = REPOSITORY / "scenarios" / "corridor.toml"
    text = shipped.read_text().replace("../maps", str(REPOSITORY / "maps"))
    file = tmp_path / "corridor.toml"
    file.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    if encoding != "utf-16":
        assert load_scenario(file).run == msgspec.structs.replace(
            load_scenario(shipped).run, modules=str(tmp_path)
        )
        return
    with pytest.raises(AcrcError, match=r"the scenario file is UTF-16; save it as UTF-8$"):
        load_scenario(file)


def test_a_folder_whose_name_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    done = in_process.acrc(*RUN, "--out", os.fsdecode(b"\xff\xfeout"), cwd=tmp_path)
    assert done.returncode == 2 and "not UTF-8" in done.stderr and not list(tmp_path.iterdir())
