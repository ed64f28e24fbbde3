"""Physical domains: their colours, and the units of elements in them."""

from __future__ import annotations

#: The colour of every domain, one of `style.SERIES`.
COLOUR = {
    "mechanical": "s1",
    "electrical": "s2",
    "hydraulic": "s3",
    "acoustic": "s4",
    "thermal": "s5",
    "rotational": "s6",
    "magnetic": "s7",
}
#: SI units of inertia, compliance and resistance (thermal: temperature and heat flow, a pseudo bond graph).
ELEMENT_UNITS = {
    "mechanical": {"I": "kg", "C": "m/N", "R": "N·s/m"},
    "rotational": {"I": "kg·m²", "C": "rad/(N·m)", "R": "N·m·s/rad"},
    "electrical": {"I": "H", "C": "F", "R": "Ω"},
    "magnetic": {"C": "H", "R": "1/Ω"},
    "hydraulic": {"I": "kg/m⁴", "C": "m³/Pa", "R": "Pa·s/m³"},
    "acoustic": {"I": "kg/m⁴", "C": "m³/Pa", "R": "Pa·s/m³"},
    "thermal": {"C": "J/K", "R": "K/W"},
}
