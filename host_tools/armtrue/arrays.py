"""The array type of this package: doubles, of the shape that a function's docstring gives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
