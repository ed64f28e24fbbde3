"""Linear time-invariant systems: signals, exact propagation, frequency response, zeros and poles."""

from dynid.lti.certified import roots
from dynid.lti.pencil.system import zeros_poles

__all__ = ["roots", "zeros_poles"]
