"""What functions of this package mean by an array: numbers as doubles, of the shape that their docstrings give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
