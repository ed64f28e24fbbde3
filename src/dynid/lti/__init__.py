"""Linear time-invariant systems: signals, exact propagation, frequency response, zeros and poles."""

from dynid.lti.certified import roots

__all__ = ["roots"]
