"""Reads and writes of knowledge by a process or an exchange, by static analysis of its source.

Read are all fields accessed as attributes, in the function and in all properties, methods and functions that
receive the knowledge and whose source is available; written are all keywords of `replace(knowledge, ...)`.
Unreachable code counts, and so do fields read after they were replaced. Everything else is not guessed but
listed as unknown.
"""

import ast
import builtins
import copy
import dataclasses
import functools
import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from deeco import replace

Definition = ast.FunctionDef | ast.AsyncFunctionDef


def definition(function: Callable[..., Any]) -> Definition | None:
    """Return the syntax tree of a function; None if it has no source or is not made by `def`."""
    try:
        text = inspect.getsource(inspect.unwrap(function))
        # A method is indented, but lines of its multi-line strings may not be, so that dedent would fail.
        tree = ast.parse("if True:\n" + text if text[:1].isspace() else text)
    except (OSError, TypeError, SyntaxError):
        return None
    first = tree.body[0]
    inner = first.body[0] if isinstance(first, ast.If) else first
    return inner if isinstance(inner, Definition) else None


def resolve_name(expression: ast.expr, function: Callable[..., Any]) -> object | None:
    """Return the object that a (dotted) name denotes outside the function; None if unknown."""
    if isinstance(expression, ast.Attribute):
        owner = resolve_name(expression.value, function)
        return None if owner is None else inspect.getattr_static(owner, expression.attr, None)
    if not isinstance(expression, ast.Name):
        return None
    plain = inspect.unwrap(function)
    code = getattr(plain, "__code__", None)
    if code is None or expression.id in code.co_varnames or expression.id in code.co_cellvars:
        return None
    if expression.id in code.co_freevars:
        return _enclosed(plain, expression.id)
    found: object = plain.__globals__.get(expression.id, getattr(builtins, expression.id, None))
    return found


def _enclosed(function: Callable[..., Any], name: str) -> object | None:
    cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    try:
        found: object = cells[name].cell_contents
    except ValueError:  # not assigned yet
        return None
    return found


def can_follow(target: object) -> bool:
    """Return whether `target` is a function outside the standard library."""
    if not inspect.isfunction(target):
        return False
    package = (target.__module__ or "").partition(".")[0]
    return package not in sys.stdlib_module_names or package == "__main__"


def parameters(tree: Definition) -> tuple[str, ...]:
    """Return the names of the positional parameters in order."""
    return tuple(one.arg for one in (*tree.args.posonlyargs, *tree.args.args))


def excerpt(tree: ast.AST) -> str:
    """Return the source of a node on one line of at most 60 characters."""
    text = " ".join(ast.unparse(tree).split())
    return text if len(text) <= 60 else text[:59] + "…"


_REPLACE: Final = (replace, dataclasses.replace, getattr(copy, "replace", dataclasses.replace))
_READ_NOTHING: Final = (isinstance, type, id)
_READ_ALL: Final = (repr, str, hash, dataclasses.asdict, dataclasses.astuple)


class Subject(NamedTuple):
    """Knowledge tracked through a function."""

    label: str
    """Parameter of the outermost function through which it was passed."""
    kind: type


@dataclass
class Flow:
    """Fields read and written, by subject label; dicts serve as ordered sets."""

    reads: dict[str, dict[str, None]] = field(default_factory=dict)
    writes: dict[str, dict[str, None]] = field(default_factory=dict)
    unknowns: dict[str, None] = field(default_factory=dict)
    """Unresolved accesses, to be read after "unknown"."""

    def read(self, label: str) -> tuple[str, ...]:
        """Return the names of the fields read."""
        return tuple(self.reads.get(label, ()))

    def written(self, label: str) -> tuple[str, ...]:
        """Return the names of the fields written."""
        return tuple(self.writes.get(label, ()))


def analyse_flow(
    function: Callable[..., Any], subjects: Mapping[str, type], *, returns_knowledge: bool = False
) -> Flow:
    """Analyse a function whose parameters `subjects` receive knowledge of these classes.

    With `returns_knowledge`, returning anything but knowledge is unknown.
    """
    found = Flow()
    known = {name: Subject(name, kind) for name, kind in subjects.items()}
    reading = _FunctionAnalysis(function, known, found, {})
    if reading.tree is None:
        found.unknowns[f"reads and writes of {function.__name__}(), whose source is not available"] = None
        return found
    reading.run()
    if returns_knowledge:
        found.unknowns |= dict.fromkeys(f"writes of `{excerpt(one)}`" for one in reading.other_returns)
    return found


_Followed = dict[tuple[object, ...], Subject | None]


class _FunctionAnalysis:
    """Analysis of one function, with the names in it that denote knowledge."""

    def __init__(
        self, function: Callable[..., Any], known: dict[str, Subject], found: Flow, followed: _Followed
    ) -> None:
        self.function = function
        self.tree = definition(function)
        self.other_returns: list[ast.Return] = []
        """Return statements with anything but knowledge."""
        self._known = known
        self._classes: dict[str, type] = {}
        """Classes of objects that the function creates, by variable name."""
        self._found = found
        self._followed = followed
        self._returned_subject: Subject | None = None

    def run(self) -> Subject | None:
        """Analyse the function; return the knowledge that it always returns, if so."""
        assert self.tree is not None
        before = -1
        while before < len(self._known):  # a loop may use a name before the line that binds it
            before = len(self._known)
            self.other_returns.clear()
            for statement in self.tree.body:
                self._visit(statement)
        return None if self.other_returns else self._returned_subject

    def _visit(self, node: ast.AST) -> None:
        """Visit a statement, or a part of one that is not an expression."""
        match node:
            case ast.Return(value=value):
                self._returned(node, value)
            case ast.Assign(targets=[target], value=value):
                self._assigned(target, value)
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                self._bind(name, self._value(value))
            case ast.Expr(value=value):
                self._value(value)
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda():
                self._nested(node)
            case _:
                self._parts(node)

    def _parts(self, node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                if subject := self._value(child):
                    self._add_unknown(f"reads of {subject.label} in `{excerpt(node)}`")
            else:
                self._visit(child)

    def _nested(self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> None:
        own = {one.arg for one in ast.walk(node.args) if isinstance(one, ast.arg)}
        known, returned_subject, other_returns = self._known, self._returned_subject, list(self.other_returns)
        self._known = {name: subject for name, subject in known.items() if name not in own}
        for part in node.body if isinstance(node.body, list) else [ast.Expr(node.body)]:
            self._visit(part)
        self._known, self._returned_subject, self.other_returns[:] = known, returned_subject, other_returns

    def _returned(self, node: ast.Return, value: ast.expr | None) -> None:
        if value is None or (isinstance(value, ast.Constant) and value.value is None):
            return
        subject = self._value(value)
        if subject is None or (self._returned_subject and self._returned_subject != subject):
            self.other_returns.append(node)
        else:
            self._returned_subject = subject

    def _assigned(self, target: ast.expr, value: ast.expr) -> None:
        match target, value:
            case ast.Name(id=name), _:
                self._bind(name, self._value(value))
                if made := self._class_of(value):
                    self._classes[name] = made
            case ast.Tuple(elts=names), ast.Tuple(elts=values) if len(names) == len(values):
                for one, other in zip(names, values, strict=True):
                    self._assigned(one, other)
            case _:
                if subject := self._value(value):
                    self._add_unknown(f"reads of {subject.label} through `{excerpt(target)}`")
                self._value(target)

    def _bind(self, name: str, subject: Subject | None) -> None:
        if subject:
            self._known[name] = subject

    def _value(self, node: ast.expr) -> Subject | None:
        """Visit an expression; return the subject if its value is knowledge."""
        match node:
            case ast.Name(id=name, ctx=ast.Load()):
                return self._known.get(name)
            case ast.Attribute(value=owner, attr=name):
                subject = self._value(owner)
                return self._attribute(subject, name) if subject else None
            case ast.Call():
                return self._call(node)
            case ast.IfExp(test=test, body=body, orelse=otherwise):
                self._value(test)
                return self._either(node, self._value(body), self._value(otherwise))
            case ast.NamedExpr(target=target, value=value):
                self._bind(target.id, subject := self._value(value))
                return subject
            case ast.Compare():
                self._compared(node)
            case ast.Lambda():
                self._nested(node)
            case _:
                self._parts(node)
        return None

    def _either(self, node: ast.expr, one: Subject | None, other: Subject | None) -> Subject | None:
        if one == other:
            return one
        for subject in filter(None, (one, other)):
            self._add_unknown(f"reads of {subject.label} through `{excerpt(node)}`")
        return None

    def _compared(self, node: ast.Compare) -> None:
        identity = all(isinstance(one, ast.Is | ast.IsNot) for one in node.ops)
        for side in (node.left, *node.comparators):
            if (subject := self._value(side)) and not identity:
                self._read_all(subject)

    def _attribute(self, subject: Subject, name: str) -> Subject | None:
        if name in _fields(subject.kind):
            self._found.reads.setdefault(subject.label, {})[name] = None
            return None
        there = inspect.getattr_static(subject.kind, name, None)
        if isinstance(there, property) and there.fget:
            return self._follow(there.fget, [subject], {})
        if isinstance(there, functools.cached_property):
            return self._follow(there.func, [subject], {})
        if inspect.isfunction(there):
            return self._follow(there, [subject], {})
        if (there is None or hasattr(type(there), "__get__")) and name != "__class__":
            self._add_unknown(f"reads of {subject.label}.{name}")
        return None

    def _call(self, call: ast.Call) -> Subject | None:
        if isinstance(call.func, ast.Attribute):
            if _is_super(call.func.value):
                return self._super_call(call, call.func.attr)
            if receiver := self._value(call.func.value):
                return self._method_call(call, receiver, call.func.attr)
            made = self._class_of(call.func.value)
            method = made and inspect.getattr_static(made, call.func.attr, None)
            if can_follow(method):
                return self._with_arguments(method, [None], call)
        elif not isinstance(call.func, ast.Name):
            self._value(call.func)
        target = resolve_name(call.func, self.function)
        if target in _REPLACE and call.args:
            return self._replaced(call)
        return self._function_call(call, target)

    def _class_of(self, node: ast.expr) -> type | None:
        """Return the class of an object that the function makes; None if unknown."""
        if isinstance(node, ast.Name):
            return self._classes.get(node.id)
        made = resolve_name(node.func, self.function) if isinstance(node, ast.Call) else None
        return made if isinstance(made, type) else None

    def _replaced(self, call: ast.Call) -> Subject | None:
        subject = self._value(call.args[0])
        for keyword in call.keywords:
            if whole := self._value(keyword.value):
                self._read_all(whole)
            if subject and keyword.arg is None:
                self._add_unknown(f"writes of `{excerpt(call)}`")
            elif subject and keyword.arg:
                self._found.writes.setdefault(subject.label, {})[keyword.arg] = None
        return subject

    def _method_call(self, call: ast.Call, receiver: Subject, name: str) -> Subject | None:
        there = inspect.getattr_static(receiver.kind, name, None)
        if not isinstance(there, staticmethod | classmethod) and not can_follow(there):
            self._arguments(call.args, call.keywords, call)
            return self._attribute(receiver, name)
        if isinstance(there, staticmethod):
            return self._with_arguments(there.__func__, [], call)
        if isinstance(there, classmethod):
            return self._with_arguments(there.__func__, [None], call)
        return self._with_arguments(there, [receiver], call)

    def _super_call(self, call: ast.Call, name: str) -> Subject | None:
        assert self.tree is not None
        first = self._known.get(next(iter(parameters(self.tree)), ""))
        function = first and _next_method(first.kind, self.function, name)
        if first and can_follow(function):
            return self._with_arguments(function, [first], call)
        self._add_unknown(f"reads and writes of {excerpt(call)}")
        return None

    def _function_call(self, call: ast.Call, target: object) -> Subject | None:
        if can_follow(target):
            return self._with_arguments(target, [], call)
        if target is getattr and len(call.args) > 1 and isinstance(call.args[1], ast.Constant):
            subject = self._value(call.args[0])
            return self._attribute(subject, str(call.args[1].value)) if subject else None
        subjects = [self._value(one) for one in call.args]
        subjects += [self._value(one.value) for one in call.keywords]
        for subject in filter(None, subjects):
            if target in _READ_ALL:
                self._read_all(subject)
            elif target not in _READ_NOTHING:
                self._add_unknown(f"reads of {subject.label} in `{excerpt(call)}`")
        return None

    def _with_arguments(self, function: Any, first: list[Subject | None], call: ast.Call) -> Subject | None:
        positional, named = self._arguments(call.args, call.keywords, call)
        return self._follow(function, first + positional, named)

    def _arguments(
        self, positional: list[ast.expr], named: list[ast.keyword], call: ast.Call
    ) -> tuple[list[Subject | None], dict[str, Subject]]:
        """Visit the arguments; return those that are knowledge, by position and by name."""
        by_place = [self._value(one) for one in positional]
        by_name: dict[str, Subject] = {}
        for keyword in named:
            subject = self._value(keyword.value)
            if subject and keyword.arg:
                by_name[keyword.arg] = subject
        if any(isinstance(one, ast.Starred) for one in positional) and any(by_place):
            self._add_unknown(f"argument order of `{excerpt(call)}`")
        return by_place, by_name

    def _follow(
        self, function: Callable[..., Any], positional: list[Subject | None], named: dict[str, Subject]
    ) -> Subject | None:
        """Analyse a called function with these arguments; None stands for anything but knowledge."""
        if not any(positional) and not named:
            return None
        key = (function, *positional, *sorted(named.items()))
        if key in self._followed:
            return self._followed[key]
        self._followed[key] = None
        inner = _FunctionAnalysis(function, dict(named), self._found, self._followed)
        names = parameters(inner.tree) if inner.tree else ()
        if inner.tree is None or any(positional[len(names) :]):
            self._add_unknown(f"further reads in {function.__qualname__}()")
            return None
        inner._known |= {name: one for name, one in zip(names, positional, strict=False) if one}
        self._followed[key] = inner.run()
        return self._followed[key]

    def _read_all(self, subject: Subject) -> None:
        self._found.reads.setdefault(subject.label, {}).update(dict.fromkeys(_fields(subject.kind)))

    def _add_unknown(self, unknown: str) -> None:
        self._found.unknowns[unknown] = None


def _fields(kind: type) -> tuple[str, ...]:
    return tuple(one.name for one in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else ()


def _is_super(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super"


def _next_method(kind: type, function: Callable[..., Any], name: str) -> object | None:
    """Return the attribute that `super().name` denotes in a method of a base of `kind`."""
    order = kind.__mro__
    owner = next((place for place, base in enumerate(order) if function in vars(base).values()), len(order))
    return next((vars(base)[name] for base in order[owner + 1 :] if name in vars(base)), None)
