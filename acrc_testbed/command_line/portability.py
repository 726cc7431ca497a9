"""Check of cores for non-portable arithmetic: methods, operators and compiler options.

ruff bans functions and modules (`banned-api` in pyproject.toml).
"""

import ast
import re
import sys
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import REPOSITORY

PACKAGES: Final = ("actors", "cleaning", "deeco", "firmware_bridge", "logistics")
"""Packages with cores."""
EXEMPT: Final = ("actors/observer", "actors/runtime", "deeco/explain")
"""Code in these packages that is not part of a core."""
_SUM_METHODS: Final = {"sum", "mean", "std", "var", "prod", "dot", "trace", "reduce", "reduceat"}
_UNSTABLE_SORTS: Final = {"argsort", "argpartition"}
_DRAW_METHODS: Final = re.compile(
    "standard_(normal|exponential|gamma|t|cauchy)|(log|multivariate_)?normal|exponential|gamma|beta|power|f|"
    "(noncentral_)?chisquare|laplace|logistic|gumbel|pareto|weibull|rayleigh|vonmises|wald|triangular|uniform|"
    "poisson|(negative_)?binomial|multinomial|dirichlet|(hyper)?geometric|logseries|zipf"
)
_ORDER: Final = "adds in an order that depends on the processor; use actors.portable.arrays.total or a loop"
_POWER: Final = "is the C library's power function; write products, or use exp10, exp, log of actors.portable"


class PortabilityFinding(NamedTuple):
    """Arithmetic in a core whose result may differ on another processor."""

    path: str
    line: int
    problem: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.problem}"


def findings(root: Path = REPOSITORY) -> list[PortabilityFinding]:
    """Return the findings in the cores of a clone."""
    found = []
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            if not name.startswith(EXEMPT):
                found += findings_in(path.read_text(encoding="utf-8"), name)
    return found


def findings_in(source: str, path: str) -> list[PortabilityFinding]:
    """Return the findings in one file."""
    tree = ast.parse(source, path)
    modules = {
        alias.asname or alias.name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    found = [
        PortabilityFinding(path, node.lineno, problem)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call | ast.BinOp | ast.AugAssign) and (problem := _problem(node, modules))
    ]
    return sorted(set(found))


def main() -> int:
    """Print the findings; return 1 if there are any."""
    found = findings()
    sys.stdout.writelines(f"{one}\n" for one in found)
    return 1 if found else 0


def _problem(node: ast.Call | ast.BinOp | ast.AugAssign, modules: set[str]) -> str:
    if isinstance(node, ast.BinOp):
        return _operator_problem(node.op, node.left, node.right)
    if isinstance(node, ast.AugAssign):
        return _operator_problem(node.op, node.target, node.value)
    options = {one.arg: ast.unparse(one.value) for one in node.keywords}
    if any(options.get(name, "False") != "False" for name in ("fastmath", "parallel")):
        return "fastmath and parallel let the compiler reorder arithmetic; remove them"
    if isinstance(node.func, ast.Attribute):
        return _method_problem(node.func, options, modules)
    if isinstance(node.func, ast.Name):
        return _builtin_problem(node, node.func.id)
    return ""


def _method_problem(called: ast.Attribute, options: dict[str | None, str], modules: set[str]) -> str:
    name = called.attr
    if name in _UNSTABLE_SORTS and options.get("kind") not in {"'stable'", '"stable"'}:
        return f'{name} orders equal elements by processor; pass kind="stable"'
    if isinstance(called.value, ast.Constant) or ast.unparse(called.value).split(".")[0] in modules:
        return ""
    if name in _SUM_METHODS and not options.get("dtype", "").endswith(".int64"):
        return f".{name}() {_ORDER}, or dtype=np.int64 for integers"
    return (
        f".{name}() draws through the C library; use actors.portable.draws"
        if _DRAW_METHODS.fullmatch(name)
        else ""
    )


def _builtin_problem(node: ast.Call, name: str) -> str:
    if name == "pow" and len(node.args) == 2:
        return f"pow() {_POWER}"
    if name == "sum" and not (isinstance(node.args[0], ast.GeneratorExp) and _is_integer(node.args[0].elt)):
        return "sum() of floats compensates from Python 3.12 on; use math.fsum, or sum(int(…) for …)"
    return ""


def _operator_problem(operator: ast.operator, left: ast.expr, right: ast.expr) -> str:
    if isinstance(operator, ast.MatMult):
        return f"@ {_ORDER}"
    exact = ast.unparse(left).startswith("Fraction(") or (
        _is_integer_literal(left) and _is_integer_literal(right)
    )
    return f"** {_POWER}" if isinstance(operator, ast.Pow) and not exact else ""


def _is_integer_literal(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int


def _is_integer(node: ast.expr) -> bool:
    """Return whether a term is an integer by syntax: a comparison, len(…), int(…) or a literal."""
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in {"len", "int", "bool", "isinstance"}
    return isinstance(node, ast.Compare) or _is_integer_literal(node)


if __name__ == "__main__":
    sys.exit(main())
