"""Registration of this package's functions with numba, before the first kernel is compiled.

numba compiles the source that plain Python runs, except `two_to` and `halved`, which work on the bits.
Divisions follow IEEE 754 (no exception), and nothing is contracted to fused operations, which numba allows
LLVM only with fastmath.
"""

from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core.typing import signature
from numba.extending import intrinsic, overload, register_jitable

from actors.portable import elementary

_IEEE: Final = {"error_model": "numpy", "forceinline": True}
_DOUBLE: Final = ir.DoubleType()
_INT64: Final = ir.IntType(64)
_FRACTION: Final = 0x000FFFFFFFFFFFFF
_HALF: Final = 0x3FE0000000000000


@intrinsic  # type: ignore[untyped-decorator]
def _bits_of(typing: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _INT64)

    return signature(types.int64, types.float64), generate


@intrinsic  # type: ignore[untyped-decorator]
def _float_of(typing: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _DOUBLE)

    return signature(types.float64, types.int64), generate


@overload(elementary.two_to, jit_options=_IEEE, strict=False)  # type: ignore[untyped-decorator]
def _two_to(k: Any) -> Any:
    return lambda k: _float_of((k + 1023) << 52)


@overload(elementary.halved, jit_options=_IEEE, strict=False)  # type: ignore[untyped-decorator]
def _halved(x: Any) -> Any:
    def on_bits(x: float) -> tuple[float, int]:
        bits = _bits_of(x)
        return _float_of((bits & _FRACTION) | _HALF), (bits >> 52) - 1022

    return on_bits


def register() -> None:
    """Register the elementary functions; numba then compiles them where a kernel calls them."""
    for name, function in list(vars(elementary).items()):
        if getattr(function, "__module__", "") == elementary.__name__ and name not in {"two_to", "halved"}:
            register_jitable(**_IEEE)(function)
