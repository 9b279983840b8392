"""Types of arrays.

Functions of a compiled model take `(t, x, z, u, p, m)`: the time [s], states (nx,), algebraic variables (nz,), inputs
(nu,), parameters (np,) and modes (nm,), in SI units and in the order of `CompiledModel.states`, `algebraic`, `inputs`,
`parameters` and `modes`. At n instants they have a column for each: x is (nx, n). Docstrings name all other shapes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Truth = NDArray[np.bool_]
Indices = NDArray[np.int64]
Complex = NDArray[np.complex128]
