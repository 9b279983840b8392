"""Types of arrays; their shapes are said where they stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Truth = NDArray[np.bool_]
Indices = NDArray[np.int64]
Complex = NDArray[np.complex128]
