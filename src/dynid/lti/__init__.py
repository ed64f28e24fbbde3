"""Linear time-invariant systems: signals, exact propagation, frequency response, poles and zeros."""
