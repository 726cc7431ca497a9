"""Compiled kernels belong to one state of what they are made of: a change there leads to another cache."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import actors


def cache_of(folder: Path) -> str:
    """The cache that a process uses whose `actors` lies in `folder`."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-P", "-S", "-c", "import actors, os; print(os.environ['NUMBA_CACHE_DIR'])"],
        env=environment | {"PYTHONPATH": str(folder)},  # and no installed `actors`, which would come first
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_a_change_of_what_a_kernel_is_made_of_leads_to_another_cache_and_no_other_change(
    tmp_path: Path,
) -> None:
    package = tmp_path / "actors"
    (package / "deep").mkdir(parents=True)
    shutil.copy(str(actors.__file__), package)
    files = {
        "kernel.py": "import math\nfrom numba import njit\nfrom actors.deep import (\n    constants,\n)\n",
        "constants.py": "def late() -> None:\n    from actors.deep.numbers import ONE\n",
        "numbers.py": "ONE = 1\n",
        "apart.py": "from actors.deep.kernel import njit\n",
    }
    for name, text in files.items():
        (package / "deep" / name).write_text(text)
    first = cache_of(tmp_path)
    assert first.startswith(str(package / "__pycache__" / "kernels-"))
    for name, text in files.items():
        changed = package / "deep" / name
        changed.write_text(f"{text}TWO = 2\n")
        assert (cache_of(tmp_path) == first) is (name == "apart.py"), name
        changed.write_text(text)
        assert cache_of(tmp_path) == first


def test_every_module_with_kernels_and_what_it_calls_is_among_their_sources() -> None:
    folder = Path(str(actors.__file__)).parent
    found = {str(source.relative_to(folder)) for source in actors.kernel_sources()}
    assert {"robot/local_planning/disc_dwa.py", "portable/compiled.py", "floor/traversal.py"} <= found
    assert {"portable/trigonometry.py", "geometry.py"} <= found, "what kernels import"
    assert not {"runtime/shell.py", "robot/navigation/navigator.py"} & found, "nothing that calls kernels"
    for source in folder.rglob("*.py"):
        if "njit(" in source.read_text():
            assert str(source.relative_to(folder)) in found
