"""Linear time-invariant systems: signals, exact propagation, frequency response, zeros and poles."""

from dynid.lti.certified_roots import roots
from dynid.lti.pencil.zeros_poles import zeros_poles

__all__ = ["roots", "zeros_poles"]
