"""The functions of this package for kernels; `extensions` registers them with numba."""

from actors import portable
from actors.portable import *  # noqa: F403

__all__ = portable.__all__
