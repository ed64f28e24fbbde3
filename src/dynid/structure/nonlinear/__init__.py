"""Joints with nonlinear laws: the laws, and the march of a structure with them in time."""
