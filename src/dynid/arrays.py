"""Types of arrays."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""An array of real numbers in double precision."""

ComplexArray: TypeAlias = NDArray[np.complex128]
"""An array of complex numbers in double precision."""
