"""States of the sources from which kernels are compiled.

numba checks only a kernel's own file, not the files of kernels that it calls and inlines: after a change
there it would run outdated code, and a run would have an outdated digest. The state of a module is therefore
a hash of its kernels, its fingerprint, and every definition of this project that these use, recursively,
without comments, docstrings and the annotations of functions.
"""

import ast
import hashlib
import json
import os
import re
import shutil
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from functools import cache as remembered
from importlib.metadata import version
from pathlib import Path
from typing import Final

from actors.kernels import cache_folder, write_file

_ROOT: Final = Path(__file__).parents[1]
"""Folder of the project's packages; if these are installed, of all packages."""
_COMPILED: Final = re.compile(r"(?m)import (?:\(\s*)?(?:njit|kernel)\b|^def fingerprint\b")
"""Found in modules with kernels, and in those with other arithmetic that has a fingerprint."""
_ALL: Final = "*"
"""Stands for all definitions of a module."""
_LOOSE: Final = ""
"""Stands for the statements of a module that define no name."""
_Definition = tuple[str, str]
"""Module and name."""
_DECORATORS: Final = {("actors.kernels", "kernel"), ("actors.kernels", "njit")}
_ALWAYS: Final[tuple[_Definition, ...]] = (
    ("actors.portable.extensions", _ALL),
    ("actors.kernel_dispatchers", _ALL),
)
"""Definitions on which all kernels depend without an import: numba extensions, and the cache's format."""


def module_state(module: str) -> str | None:
    """Return the hash of all that a module's kernels and fingerprint use; None: not a module of kernels.

    The name "" stands for all kernels of this package.
    """
    return _states(module.partition(".")[0] or "actors").get(module)


@remembered
def _states(package: str) -> dict[str, str]:
    """Return the states of the kernels of `actors` and a package; saved, as the search takes a second."""
    hashed, path = hashlib.sha256(version("numba").encode()), cache_folder() / f"{package}.states"
    sources = sorted(one for name in {"actors", package} for one in _files(name))
    for source in sources:
        found = os.stat(source)  # noqa: PTH116 - faster
        hashed.update(f"{source} {found.st_size} {found.st_mtime_ns} {found.st_ctime_ns}\n".encode())
    key = hashed.hexdigest()
    states: dict[str, str] = {}
    with suppress(OSError, ValueError):
        states = json.loads(path.read_text())
    if states.get("key") != key:
        compiled = [one for one in map(Path, sources) if _COMPILED.search(one.read_text("utf-8"))]
        used = {name: _used(name) for name in map(module_name, compiled)}
        states = {name: _hash(_used(name)) for name in {one for found in used.values() for one, _ in found}}
        states |= {"key": key, "": _hash(set().union(*used.values()))}
        write_file(path, json.dumps(states).encode())
    return states


def _files(package: str) -> Iterator[str]:
    """Yield the paths of a package's sources."""
    for folder, folders, names in os.walk(_ROOT / package):
        folders[:] = [one for one in folders if one != "__pycache__"]
        yield from (f"{folder}/{name}" for name in names if name.endswith(".py"))


def prune_cache() -> None:
    """Remove kernels of outdated source states; a process that still needs one compiles it again."""
    for folder in cache_folder().glob("*-*"):
        module, _, state = folder.name.rpartition("-")
        if re.fullmatch("[0-9a-f]{16}", state) and state != module_state(module):
            shutil.rmtree(folder, ignore_errors=True)


def used_modules(module: str) -> set[str]:
    """Return the modules with definitions that the kernels of this module use."""
    return {one for one, _ in _used(module)}


def module_name(source: Path) -> str:
    """Return the dotted name of a source file of this project."""
    *folders, name = source.relative_to(_ROOT).with_suffix("").parts
    return ".".join(folders if name == "__init__" else (*folders, name))


@remembered
def _source(module: str) -> Path | None:
    """Return the file of a module; None: it is elsewhere, or a name in a module."""
    path = _ROOT.joinpath(*module.split("."))
    return next((one for one in (path.with_suffix(".py"), path / "__init__.py") if one.is_file()), None)


def _hash(used: set[_Definition]) -> str:
    hashed = hashlib.sha256(version("numba").encode())
    for module, name in sorted(used):
        for code in _module(module).code.get(name, ()):
            hashed.update(f"{module}\n{code}\n".encode())
    return hashed.hexdigest()[:16]


@remembered
def _used(module: str) -> set[_Definition]:
    """Return the definitions of its package, actors and deeco that kernels and fingerprint of a module use.

    Definitions of this module are left out: kernels do not contain them.
    A module without them may have functions from which another module makes kernels.
    """
    found: set[_Definition] = set()
    todo = [*_module(module).kernels(), *_ALWAYS]
    packages = {"actors", "deeco", module.partition(".")[0]}
    while todo:
        source, name = definition = todo.pop()
        if definition not in found and source.partition(".")[0] in packages and source != __name__:
            found.add(definition)
            todo.extend(_module(source).uses(name))
    return found


class _Module:
    """The definitions of a module with the code and the uses of each."""

    def __init__(self, name: str, text: str) -> None:
        self._name = name
        self.code: dict[str, list[str]] = defaultdict(list)
        self._uses: dict[str, set[_Definition]] = defaultdict(set)
        self._imports: dict[str, _Definition] = {}
        self._reexported: list[str] = []
        """Modules of `from MODULE import *`."""
        tree = _CodeParser().visit(ast.parse(text))
        for statement in tree.body:
            for local, module, imported in _imports(statement):
                if local == _ALL:
                    self._reexported.append(module)
                else:
                    self._imports[local] = _resolve(module, imported)
        for statement in tree.body:
            if not isinstance(statement, ast.Import | ast.ImportFrom):
                self._add(statement)

    def kernels(self) -> list[_Definition]:
        """Return the definitions that contain kernels and the fingerprint; without them, the whole module."""
        found = [name for name, used in self._uses.items() if used & _DECORATORS or name == "fingerprint"]
        return [(self._name, name) for name in found or [_ALL]]

    def _add(self, statement: ast.stmt) -> None:
        """Add a statement below each name that it defines."""
        nodes = [one for one in ast.walk(statement) if isinstance(one, ast.Name)]
        stored = [one.id for one in nodes if isinstance(one.ctx, ast.Store)]
        names = [statement.name] if isinstance(statement, _NAMED) else stored or [_LOOSE]
        code, uses = ast.unparse(statement), set(self._references(statement))
        for name in names:
            self.code[name].append(code)
            self._uses[name] |= uses

    def _references(self, statement: ast.stmt) -> Iterator[_Definition]:
        for node in ast.walk(statement):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                module, name = self._imports.get(node.value.id, ("", ""))
                if name == _ALL:
                    node.value.id = ""  # one definition of the module, not the whole
                    yield _resolve(module, node.attr)
            elif isinstance(node, ast.Name) and node.id:
                yield self._imports.get(node.id, (self._name, node.id))
            elif isinstance(node, ast.Import | ast.ImportFrom):
                for _, module, imported in _imports(node):
                    yield _resolve(module, imported)

    def uses(self, name: str) -> set[_Definition]:
        """Return the definitions that a definition, or the whole module, uses."""
        if name == _ALL:
            everything = {(self._name, one) for one in self.code} | set(self._imports.values())
            return everything.union({(one, _ALL) for one in self._reexported}, *self._uses.values())
        if name in self.code:
            return self._uses[name] | {(self._name, _LOOSE)}
        if name in self._imports:
            return {self._imports[name]}
        return {(one, name) for one in self._reexported}


_NAMED: Final = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@remembered
def _module(name: str) -> _Module:
    source = _source(name)
    return _Module(name, "" if source is None else source.read_text("utf-8"))


def _imports(node: ast.AST) -> Iterator[tuple[str, str, str]]:
    """Yield the local name, the module and the name in it, or _ALL, of what a statement imports."""
    if isinstance(node, ast.ImportFrom):
        for one in node.names:
            yield one.asname or one.name, node.module or "", one.name
    elif isinstance(node, ast.Import):
        for one in node.names:
            yield one.asname or one.name.partition(".")[0], one.name, _ALL


def _resolve(module: str, name: str) -> _Definition:
    """Return a definition; the name of a module in a package stands for the whole module."""
    return (module, name) if _source(inner := f"{module}.{name}") is None else (inner, _ALL)


class _CodeParser(ast.NodeTransformer):
    """Removes docstrings, annotations of functions, and what only type checkers run."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else node

    def visit_If(self, node: ast.If) -> ast.AST | None:
        is_checked = isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        return None if is_checked else self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node
