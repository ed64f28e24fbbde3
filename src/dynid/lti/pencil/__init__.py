"""Pencils sF - G: their finite eigenvalues, exactly and in floating point; zeros and poles of systems.

- `zeros_poles` (in `zeros_poles`): zeros and poles of state equations and descriptor systems, by either
  engine.
- `finite_eigenvalues` (in `eigenvalues`): floating-point poles or zeros of any regular pencil, dense or
  sparse, each with an error bound.
- `determinant` (in `exact`): det(sF - G) over the integers.
"""
