"""The kernel cache depends on the definitions that kernels use, and on nothing else."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from actors import kernel_sources, kernels
from actors.floor import raster
from actors.installation.repository import REPOSITORY
from actors.portable import arrays
from actors.processes import kernel_compilation
from actors.runtime import processor

CALL = """
from actors.deep import kernel
print(kernel.twice(4), sum(kernel.twice.stats.cache_misses.values()))
"""
KERNEL = "from actors.kernels import njit\nfrom actors.deep import (\n    constants,\n)\n\n\n"
TWO = "TWO = 2\nHALF = 2\n"
BOTH = {"kernel", "apart"}
LOCAL = "    from actors.deep import constants\n    "
APART = "@kernel\ndef half(x):\n    return x / numbers.HALF\n"
TWICE = "@njit()\ndef twice(x):\n    return constants.TWO * x\n"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a package `actors` with one kernel, one module that it imports, and others."""
    folder = tmp_path / "actors"
    (folder / "deep").mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "portable").mkdir()
    (folder / "portable" / "extensions.py").write_text("def register() -> None: pass\n")
    for module in ("kernels.py", "kernel_dispatchers.py", "kernel_sources.py"):
        shutil.copy(Path(str(kernels.__file__)).parent / module, folder / module)
    (folder / "deep" / "kernel.py").write_text(KERNEL + TWICE)
    (folder / "deep" / "constants.py").write_text("from actors.deep.numbers import TWO\n")
    (folder / "deep" / "numbers.py").write_text(TWO)
    (folder / "deep" / "others.py").write_text(TWO)
    (folder / "deep" / "apart.py").write_text(
        "from actors.kernels import kernel\nfrom actors.deep import numbers\n\n\n" + APART
    )
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


def states() -> dict[str, str]:
    remembered = (
        kernel_sources._source,
        kernel_sources._module,
        kernel_sources._used,
        kernel_sources._states,
    )
    try:
        for function in remembered:
            function.cache_clear()
        return kernel_sources._states("actors")
    finally:
        for function in remembered:
            function.cache_clear()


@pytest.mark.parametrize(
    ("file", "text", "changed"),
    [
        ("numbers", TWO.replace("TWO = 2", "TWO = 3"), {"kernel"}),
        ("numbers", TWO.replace("HALF = 2", "HALF = 3"), {"apart"}),
        ("numbers", f"{TWO}OTHER = 4\n", set()),
        ("numbers", f'"""Numbers."""\n{TWO}"""Two."""  # a comment\n', set()),
        ("numbers", "HALF = 2\nfor TWO in (1, 2):\n    pass\n", {"kernel"}),
        ("numbers", f"{TWO}print(HALF)\n", BOTH),
        ("numbers", "from actors.deep.others import *\n", BOTH),
        ("numbers", "from actors.deep.others import HALF\nTWO = 2\n", {"apart"}),
        ("kernel", KERNEL + "# a comment\n\n" + TWICE.replace("(x)", "(x: int) -> int"), set()),
        ("kernel", KERNEL + TWICE.replace("* x", "+ x"), {"kernel"}),
        ("kernel", KERNEL + TWICE + "def call():\n    return twice(2)\n", set()),
        ("kernel", "from actors.kernels import njit\n" + TWICE.replace("    ", LOCAL), {"kernel"}),
        ("constants", "from actors.deep.others import TWO\n", {"kernel"}),
        ("kernel_dispatchers", "FORMAT = 2\n", BOTH),
    ],
)  # fmt: skip
def test_a_change_affects_only_kernels_that_use_what_changes(
    package: Path, file: str, text: str, changed: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_sources, "_ROOT", package.parent)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package / "cache"))
    before = states()
    path = next(package.rglob(f"{file}.py"))
    path.write_text(text if path.parent != package else path.read_text() + text)
    after = states()
    assert {name for name in BOTH if before[f"actors.deep.{name}"] != after[f"actors.deep.{name}"]} == changed
    assert (before[""] != after[""]) is bool(changed)


def test_states_end_at_installed_packages_beside_the_projects(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_sources, "_ROOT", package.parent)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package / "cache"))
    (package / "deep" / "kernel.py").write_text(
        f"import other\n{KERNEL}{TWICE.replace('x)', 'x, y=other.X)')}"
    )
    (package.parent / "other").mkdir()
    other = package.parent / "other" / "__init__.py"
    found = []
    for text in ("X = 1\n", "X = 2\n"):
        other.write_text(text)
        found.append(states())
    assert found[0] == found[1] and "actors.deep.kernel" in found[0]
    assert not any(name.startswith("other") for name in found[0])


def test_the_state_of_a_kernel_contains_every_global_name_that_it_uses() -> None:
    checked = 0
    for module in kernel_compilation.kernel_modules():
        found = kernel_sources._used(module.__name__)
        for value in list(vars(module).values()):
            function = getattr(value, "function", getattr(value, "py_func", None))
            if function is None or function.__module__ != module.__name__:
                continue
            for name in function.__code__.co_names:
                used = function.__globals__.get(name)
                if used is not None and not isinstance(used, ModuleType):
                    checked += 1
                    assert any(one == name for _, one in found), (function, name)
                    source = getattr(used, "function", getattr(used, "py_func", None))
                    if source is not None:
                        assert (source.__module__, source.__name__) in found, (function, name)
    assert checked > 300


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
    (package / "deep" / "numbers.py").write_text(TWO)
    assert python(package, CALL) == "8 0", "the state before is kept"


@pytest.mark.nightly
def test_kernels_of_read_only_sources_are_in_the_user_cache(package: Path) -> None:
    (package / "__pycache__").mkdir(exist_ok=True)
    (package / "__pycache__" / "kernels").touch()  # no folder: also the superuser can write nothing into it
    assert python(package, CALL) == "8 1"
    assert python(package, CALL) == "8 0"
    assert len(list((package.parent / "home").rglob("*.nbc"))) == 1


@pytest.mark.nightly
def test_prune_keeps_the_current_state_only(package: Path) -> None:
    folder = package / "__pycache__" / "kernels"
    for number in (2, 3, 4):
        (package / "deep" / "numbers.py").write_text(f"TWO = {number}\n")
        python(package, CALL)
    (folder / "actors.gone-0123456789abcdef").mkdir()
    assert len(list(folder.glob("actors.deep.kernel-*"))) == 3
    python(package, "from actors import kernel_sources; kernel_sources.prune_cache()")
    assert len(list(folder.glob("actors.deep.kernel-*"))) == 1
    assert not list(folder.glob("actors.gone-*"))
    assert python(package, CALL) == "16 0"


def test_every_module_with_kernels_has_a_state_of_all_that_they_use_and_nothing_else() -> None:
    used = kernel_sources.used_modules("actors.robot.navigation.disc_dwa")
    assert {"actors.portable.elementary", "actors.portable.extensions"} <= used, "for all kernels"
    assert {"actors.robot.navigation.disc_dwa", "actors.robot.navigation.map_grid"} <= used
    assert not {"actors.runtime.shell", "actors.robot.navigation.navigator"} & used, (
        "nothing that calls kernels"
    )
    for source in REPOSITORY.glob("*/**/*.py"):
        name = kernel_sources.module_name(source)
        if name.startswith(("actors", "cleaning", "logistics")):
            text = source.read_text()
            assert "from numba import njit" not in text, source
            assert ("@njit(" not in text and "@kernel" not in text) or kernel_sources.module_state(name)


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
