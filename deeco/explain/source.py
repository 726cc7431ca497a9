"""The source of functions, and what the names in it mean where they were defined."""

import ast
import builtins
import inspect
import sys
from collections.abc import Callable
from typing import Any

Definition = ast.FunctionDef | ast.AsyncFunctionDef


def definition(function: Callable[..., Any]) -> Definition | None:
    """The syntax tree of a function; None if it has no source, or is not made by `def`."""
    try:
        text = inspect.getsource(inspect.unwrap(function))
        # A method is indented, and lines of a text within it perhaps not, so that dedenting would not do.
        tree = ast.parse("if True:\n" + text if text[:1].isspace() else text)
    except (OSError, TypeError, SyntaxError):
        return None
    first = tree.body[0]
    inner = first.body[0] if isinstance(first, ast.If) else first
    return inner if isinstance(inner, Definition) else None


def meaning(expression: ast.expr, function: Callable[..., Any]) -> object | None:
    """What a name, or names joined by dots, stand for outside the function; None if that cannot be told."""
    if isinstance(expression, ast.Attribute):
        owner = meaning(expression.value, function)
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
    """True for a function that belongs neither to Python nor to its standard library."""
    if not inspect.isfunction(target):
        return False
    package = (target.__module__ or "").partition(".")[0]
    return package not in sys.stdlib_module_names or package == "__main__"


def parameters(tree: Definition) -> tuple[str, ...]:
    """Names of the parameters that arguments without a name go to, in their order."""
    return tuple(one.arg for one in (*tree.args.posonlyargs, *tree.args.args))


def shortened(tree: ast.AST) -> str:
    """The source of an expression or statement on one line of at most 60 characters."""
    text = " ".join(ast.unparse(tree).split())
    return text if len(text) <= 60 else text[:59] + "…"
