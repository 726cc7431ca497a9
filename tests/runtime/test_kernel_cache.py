"""The kernel cache depends on the content of all imported sources, and on nothing else."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from actors import kernels
from actors.floor import raster
from actors.portable import arrays
from actors.runtime import processor

STATES = """
import json
from actors import kernels
named = kernels._named().items()
print(json.dumps({name: kernels.source_hash(kernels.imported_sources(source)) for name, source in named}))
"""
CALL = """
from actors.deep import kernel
print(kernel.twice(4), sum(kernel.twice.stats.cache_misses.values()))
"""
KERNEL = "from actors.kernels import njit\nfrom actors.deep import (\n    constants,\n)\n\n\n"
TWICE = "@njit()\ndef twice(x):\n    return constants.TWO * x\n"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a package `actors` with one kernel, one module that it imports, and others."""
    folder = tmp_path / "actors"
    (folder / "deep").mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "portable").mkdir()
    (folder / "portable" / "extensions.py").write_text("def register() -> None: pass\n")
    for module in ("kernels.py", "kernel_dispatchers.py"):
        shutil.copy(Path(str(kernels.__file__)).with_name(module), folder)
    (folder / "deep" / "kernel.py").write_text(KERNEL + TWICE)
    (folder / "deep" / "constants.py").write_text("from actors.deep.numbers import TWO\n")
    (folder / "deep" / "numbers.py").write_text("TWO = 2\n")
    (folder / "deep" / "apart.py").write_text("from actors.deep.kernel import twice\n")
    return folder


def python(package: Path, program: str) -> str:
    """Return the output of a program that imports this `actors` instead of the installed one."""
    path = os.pathsep.join([str(package.parent), *(one for one in sys.path if "site-packages" in one)])
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    home = {"HOME": str(package.parent), "XDG_CACHE_HOME": str(package.parent / "home")}
    # -B: in one second, byte code of a file would be taken for that of a later one of the same length
    done = subprocess.run(
        [sys.executable, "-B", "-P", "-S", "-c", program], text=True, capture_output=True, check=True,
        env=kept | home | {"PYTHONPATH": path},
    )  # fmt: skip
    return done.stdout.strip()


def test_change_affects_only_kernels_that_import_it(package: Path) -> None:
    before = json.loads(python(package, STATES))
    (package / "deep" / "numbers.py").write_text("TWO = 3\n")
    after = json.loads(python(package, STATES))
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {f"actors.deep.{name}" for name in ("kernel", "constants", "numbers", "apart")}
    (package / "deep" / "apart.py").write_text("from actors.deep.kernel import twice as double\n")
    last = json.loads(python(package, STATES))
    assert {name for name in after if after[name] != last[name]} == {"actors.deep.apart"}


@pytest.mark.nightly
def test_a_kernel_is_compiled_once_and_again_when_what_it_imports_changes(package: Path) -> None:
    assert python(package, CALL) == "8 1"
    (one,) = (package / "__pycache__" / "kernels").rglob("*.nbc")
    one.write_bytes(one.read_bytes()[:100])
    assert python(package, CALL) == "8 1", "a damaged file is compiled again"
    (package / "deep" / "apart.py").write_text("")
    assert python(package, CALL) == "8 0"
    (package / "deep" / "numbers.py").write_text("TWO = 3\n")
    assert python(package, CALL) == "12 1"
    (package / "deep" / "numbers.py").write_text("TWO = 2\n")
    assert python(package, CALL) == "8 0", "the state before is kept"


@pytest.mark.nightly
def test_kernels_of_read_only_sources_are_in_the_user_cache(package: Path) -> None:
    (package / "__pycache__").mkdir(exist_ok=True)
    (package / "__pycache__" / "kernels").touch()  # no folder: also the superuser can write nothing into it
    assert python(package, CALL) == "8 1"
    assert python(package, CALL) == "8 0"
    assert len(list((package.parent / "home").rglob("*.nbc"))) == 1


@pytest.mark.nightly
def test_prune_keeps_current_and_previous_state(package: Path) -> None:
    folder = package / "__pycache__" / "kernels"
    for number in (2, 3, 4):
        (package / "deep" / "numbers.py").write_text(f"TWO = {number}\n")
        python(package, CALL)
    (folder / "actors.gone-0123456789abcdef").mkdir()
    assert len(list(folder.glob("actors.deep.kernel-*"))) == 3
    python(package, "from actors import kernels; kernels.prune_cache()")
    assert len(list(folder.glob("actors.deep.kernel-*"))) == 2
    assert python(package, CALL) == "16 0"


def test_kernel_sources_include_all_called_modules() -> None:
    folder = Path(str(kernels.__file__)).parent
    found = {str(source.relative_to(folder)) for source in kernels.kernel_sources()}
    assert {"robot/navigation/disc_dwa.py", "portable/extensions.py", "floor/raster.py"} <= found
    assert {"portable/elementary.py", "geometry.py"} <= found, "what kernels import"
    assert not {"runtime/shell.py", "robot/navigation/navigator.py"} & found, "nothing that calls kernels"
    for source in folder.rglob("*.py"):
        text = source.read_text()
        assert "from numba import njit" not in text, source
        if "@njit(" in text or "@kernel" in text:
            assert str(source.relative_to(folder)) in found


def test_importing_actors_changes_no_process_state() -> None:
    """Except for changes by numba and numpy themselves."""
    program = """
import gc, locale, os, signal, sys, warnings
import numba, numpy
def state():
    return (
        dict(os.environ), {k: v for k, v in vars(numba.config).items() if k.isupper()},
        gc.get_threshold(), gc.isenabled(), sys.flags, list(warnings.filters),
        [signal.getsignal(n) for n in signal.valid_signals()], locale.setlocale(locale.LC_ALL),
        sys.getrecursionlimit(), sys.getswitchinterval(), os.umask(0o22), os.getcwd(), list(sys.path),
        list(sys.meta_path), sys.excepthook, numpy.geterr(), numpy.get_printoptions(),
    )
os.umask(0o22)
before = state()
import actors.kernel_dispatchers, acrc_testbed
import actors.robot.program, actors.world.program, actors.radio.program
print([(a, b) for a, b in zip(before, state()) if a != b])
"""
    shell = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # it comes last then
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], env=shell, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_a_compiled_kernel_imports_numba_without_its_compiler_on_the_first_call_and_never_scipy() -> None:
    arrays.sin(np.linspace(0, 1, 5000))  # compiled, as plain Python computes few numbers
    raster.fingerprint()
    program = """
import gc, sys
import numpy
import acrc_testbed.runs
from actors.floor import raster
from actors.portable import arrays
assert "numba" not in sys.modules, "imported before a kernel is called"
arrays.sin(numpy.linspace(0, 1, 5000))
raster.fingerprint()
gc.collect()
assert "numba" in sys.modules and not {"numba.np.linalg", "scipy"} & set(sys.modules)
from numba.core.environment import lookup_environment
kept = [one for result in raster._regions.overloads.values() for one in result.referenced_envs]
assert kept and all(lookup_environment(one.env_name) is one for one in kept), "code has addresses"
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_saved_fingerprints_are_those_computed_and_invalid_or_foreign_ones_are_computed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processor, "cache_folder", lambda: tmp_path)
    computed: list[str] = []

    def hashed(module: processor.KernelModule) -> dict[str, str]:
        computed.append(module.__name__)
        return {module.__name__: "ab" * 32}

    monkeypatch.setattr(processor, "_hashed", hashed)

    def saved() -> dict[str, str]:
        monkeypatch.setattr(processor, "_known", {})
        return processor.fingerprints([raster], saved=True)

    assert saved() == saved() == {raster.__name__: "ab" * 32} and len(computed) == 1
    (file,) = tmp_path.rglob("*.fingerprint")
    for content in (b"", b"{}", b"\xff", b'{"actors.floor.raster": "forged"}', b"{}" + b" " * 100_000):
        file.write_bytes(content)
        assert saved() == {raster.__name__: "ab" * 32}, content
    assert len(computed) == 6
    for variable in ("GLIBC_TUNABLES", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME"):
        monkeypatch.setenv(variable, "x")
        processor._arithmetic.cache_clear()
        saved()
    processor._arithmetic.cache_clear()
    assert len(computed) == 9 and len([*tmp_path.rglob("*.fingerprint")]) == 4
    processor.fingerprints([raster])
    assert len(computed) == 9, "known in this process"
