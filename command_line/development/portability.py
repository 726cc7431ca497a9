"""The check that cores compute with portable arithmetic only; all else has other bits on other processors."""

import ast
import sys
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import REPOSITORY

ROOMS: Final = ("actors", "cleaning", "deeco", "firmware_bridge")
"""Where cores live."""
APART: Final = ("actors/observer", "actors/runtime", "deeco/explain/description.py")
"""What lies there without being part of a core: nothing of it enters a message of a run."""


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_MATH: Final = _words("""
    sqrt isqrt floor ceil trunc fabs fmod remainder copysign ldexp frexp modf nextafter ulp isnan isinf
    isfinite isclose inf nan pi tau e radians degrees fsum gcd lcm comb factorial
""")
"""Of the standard library's mathematics: exact, correctly rounded, or one product with a constant."""
_ELEMENTARY: Final = _words("""
    sin cos tan arcsin arccos arctan arctan2 asin acos atan atan2 sinh cosh tanh arcsinh arccosh arctanh asinh
    acosh atanh exp exp2 expm1 log log2 log10 log1p logaddexp logaddexp2 power pow float_power cbrt hypot sinc
    i0 angle
""")
_SUMS: Final = _words("""
    sum nansum mean nanmean average std nanstd var nanvar median nanmedian prod nanprod dot vdot vecdot matvec
    vecmat inner matmul tensordot einsum trace convolve correlate cov corrcoef polyfit polyval trapezoid trapz
    interp percentile quantile linalg fft reduce reduceat
""")
_METHODS: Final = _words("sum mean std var prod dot trace reduce reduceat")
_UNSTABLE: Final = _words("argsort argpartition")
_DRAWS: Final = _words("""
    standard_normal normal lognormal multivariate_normal exponential standard_exponential gamma standard_gamma
    beta chisquare noncentral_chisquare f standard_t standard_cauchy laplace logistic gumbel pareto weibull
    power rayleigh vonmises wald triangular uniform poisson binomial negative_binomial multinomial dirichlet
    geometric hypergeometric logseries zipf
""")
_MODULES: Final = _words("cmath random scipy statistics numpy.fft numpy.linalg")
_RANDOM: Final = _words("Generator PCG64 SeedSequence default_rng")
_OURS: Final = _words("acos asin atan atan2 cos exp expm1 hypot log log1p log10 sin tan")
_ARRAYS: Final = _words("atan cos exp expm1 hypot log log1p log10 sin")
_RENAMED: Final = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2"}
_SUM: Final = "use actors.portable.arrays.total, a loop, or dtype=np.int64 for whole numbers"
_PLAIN_SUM: Final = "use math.fsum; for whole numbers sum(int(…) for …)"
_DRAW: Final = "use actors.portable.draws"
_POWER: Final = "write the products out, or use exp10, or exp and log, of actors.portable"


class PortabilityFinding(NamedTuple):
    """A place where a core may compute otherwise on another processor."""

    path: str
    line: int
    what: str
    instead: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.what}; {self.instead}"


def findings(root: Path = REPOSITORY) -> list[PortabilityFinding]:
    """All of them in the cores of a clone, file by file."""
    found = []
    for room in ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            if not name.startswith(APART):
                found += in_source(path.read_text(encoding="utf-8"), name)
    return found


def in_source(source: str, path: str) -> list[PortabilityFinding]:
    """Those in one file, by line."""
    visitor = _Visitor()
    visitor.visit(ast.parse(source, path))
    return sorted({PortabilityFinding(path, line, what, instead) for line, what, instead in visitor.found})


def main() -> int:
    """Print a sentence for each; 1 if there are any."""
    found = findings()
    sys.stdout.writelines(f"{one}\n" for one in found)
    if not found:
        sys.stdout.write("every core computes with portable arithmetic only\n")
    return 1 if found else 0


class _Visitor(ast.NodeVisitor):
    """Collects (line, what, instead)."""

    def __init__(self) -> None:
        self.found: list[tuple[int, str, str]] = []
        self._modules: dict[str, str] = {}

    def _say(self, node: ast.stmt | ast.expr, what: str, instead: str) -> None:
        self.found.append((node.lineno, what, instead))

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            self._modules[alias.asname or alias.name.split(".")[0]] = alias.name
            self._check_module(node, alias.name)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        module = node.module or ""
        self._check_module(node, module)
        for alias in node.names:
            self._check_module(node, f"{module}.{alias.name}")
            self._check_name(node, module, alias.name)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        module = self._module(node.value)
        if module:
            self._check_name(node, module, node.attr)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        for keyword in node.keywords:
            if keyword.arg in {"fastmath", "parallel"} and not _is_false(keyword.value):
                self._say(node, f"{keyword.arg} lets the compiler reorder or fuse arithmetic", "leave it out")
        if isinstance(node.func, ast.Attribute):
            self._check_method(node, node.func)
        elif isinstance(node.func, ast.Name):
            self._check_builtin(node, node.func.id)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        self._check_operator(node, node.op, node.left, node.right)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._check_operator(node, node.op, node.target, node.value)
        self.generic_visit(node)

    def _module(self, node: ast.expr) -> str:
        """The dotted name of the module that an expression means, or ""."""
        if isinstance(node, ast.Name):
            return self._modules.get(node.id, "")
        if isinstance(node, ast.Attribute) and (above := self._module(node.value)):
            return f"{above}.{node.attr}"
        return ""

    def _check_module(self, node: ast.stmt, module: str) -> None:
        if any(module == one or module.startswith(one + ".") for one in _MODULES):
            self._say(node, f"{module} is not for cores", "use actors.portable and actors.randomness")

    def _check_name(self, node: ast.stmt | ast.expr, module: str, name: str) -> None:
        if module == "math" and name not in _MATH:
            self._say(node, f"math.{name} differs in its last bits between C libraries", _instead(name))
        elif module == "numpy" and name in _ELEMENTARY:
            self._say(
                node, f"numpy.{name} differs in its last bits between processors", _instead(name, "arrays.")
            )
        elif module.partition(".")[0] == "numpy" and name in _SUMS:
            self._say(node, f"{module}.{name} adds in an order that depends on the processor", _SUM)
        elif module == "numpy.random" and name not in _RANDOM:
            self._say(
                node, f"numpy.random.{name} is no stream of one actor", "use actors.randomness.generator"
            )

    def _check_method(self, node: ast.Call, called: ast.Attribute) -> None:
        name, module = called.attr, self._module(called.value)
        if name in _UNSTABLE and not _is_stable(node):
            self._say(
                node, f"{name} puts equals in an order that depends on the processor", 'say kind="stable"'
            )
        if module:
            return
        if name in _METHODS and not _is_of_integers(node):
            self._say(node, f".{name}() adds in an order that depends on the processor", _SUM)
        elif name in _DRAWS and not isinstance(called.value, ast.Constant):
            self._say(node, f".{name}() takes its draws through the C library's functions", _DRAW)

    def _check_builtin(self, node: ast.Call, name: str) -> None:
        if name == "pow" and len(node.args) == 2:
            self._say(node, "pow() is the C library's power function", _POWER)
        elif name == "sum" and not _adds_integers(node):
            self._say(node, "sum() of floats compensates from Python 3.12 on, not before", _PLAIN_SUM)

    def _check_operator(
        self, node: ast.stmt | ast.expr, operator: ast.operator, left: ast.expr, right: ast.expr
    ) -> None:
        if isinstance(operator, ast.MatMult):
            self._say(node, "@ adds in an order that depends on the processor", _SUM)
        elif isinstance(operator, ast.Pow) and not _is_exact_power(left, right):
            self._say(node, "** is the C library's power function", _POWER)


def _instead(name: str, form: str = "") -> str:
    ours = _RENAMED.get(name, name)
    if form and ours in _ARRAYS:
        return f"use actors.portable.{form}{ours}"
    if ours in _OURS:
        return f"use actors.portable.{ours} (in a kernel actors.portable.compiled.{ours})"
    return "use what actors.portable offers"


def _is_false(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is False


def _keyword(node: ast.Call, name: str) -> ast.expr | None:
    return next((keyword.value for keyword in node.keywords if keyword.arg == name), None)


def _is_stable(node: ast.Call) -> bool:
    kind = _keyword(node, "kind")
    return isinstance(kind, ast.Constant) and kind.value == "stable"


def _is_of_integers(node: ast.Call) -> bool:
    kind = _keyword(node, "dtype")
    return isinstance(kind, ast.Attribute) and kind.attr == "int64"


def _is_exact_power(base: ast.expr, exponent: ast.expr) -> bool:
    """Of whole numbers that stand in the source, or of a Fraction."""
    if isinstance(base, ast.Call) and isinstance(base.func, ast.Name) and base.func.id == "Fraction":
        return True
    return _is_whole(base) and _is_whole(exponent)


def _is_whole(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int


def _adds_integers(node: ast.Call) -> bool:
    """Whether the terms say of themselves that they are whole: comparisons, len(…), int(…), literals."""
    terms = node.args[0] if node.args else node
    return isinstance(terms, ast.GeneratorExp) and _is_integer(terms.elt)


def _is_integer(node: ast.expr) -> bool:
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in {"len", "int", "bool", "isinstance"}
    return isinstance(node, ast.Compare) or _is_whole(node)


if __name__ == "__main__":
    sys.exit(main())
