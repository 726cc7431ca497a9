"""Aliases of numpy arrays by element type; docstrings state the shapes."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Octets = NDArray[np.uint8]
Int16s = NDArray[np.int16]
Int32s = NDArray[np.int32]
Int64s = NDArray[np.int64]
Indices = NDArray[np.intp]
UInt16s = NDArray[np.uint16]
UInt64s = NDArray[np.uint64]
Flags = NDArray[np.bool_]
Records = NDArray[np.void]
