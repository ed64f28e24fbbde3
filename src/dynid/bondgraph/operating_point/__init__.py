"""Laws of elements, the equilibrium of a graph that has them, its linearisation and nonlinear response."""
