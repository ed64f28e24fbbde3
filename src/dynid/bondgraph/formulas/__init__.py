"""Formulas: programs and polynomials printed as plain text and LaTeX."""
