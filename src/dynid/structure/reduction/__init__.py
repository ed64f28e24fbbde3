"""Reduction of structures, one method a file; see `dynid.structure.reduction.methods.reduce`."""
