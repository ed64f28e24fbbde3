"""Compiled loops, and when they are used. Importing any but `compiled` loads numba."""
