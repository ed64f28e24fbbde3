"""Roots of many polynomials at once, certified in arrays of doubled precision."""
