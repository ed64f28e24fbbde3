"""Symbols of points: their outlines and classes."""

from __future__ import annotations


def mark_class(symbol: str, cls: str) -> str:
    """Return the classes of a symbol of a series."""
    return f"{cls} dot" if symbol in ("o", "square", "diamond") else f"{cls} fine"


def mark_path(symbol: str, x: float, y: float, r: float) -> str:
    """Return the path data of a symbol."""
    a, b, c = f"{x:.6g}", f"{y:.6g}", f"{r:.3g}"
    if symbol in ("o", "ring"):
        return f"M{x - r:.6g} {b}a{c} {c} 0 1 0 {2 * r:.3g} 0a{c} {c} 0 1 0 {-2 * r:.3g} 0"
    if symbol == "x":
        return f"M{x - r:.6g} {y - r:.6g}l{2 * r:.3g} {2 * r:.3g}m0 {-2 * r:.3g}l{-2 * r:.3g} {2 * r:.3g}"
    if symbol == "+":
        return f"M{x - r:.6g} {b}h{2 * r:.3g}M{a} {y - r:.6g}v{2 * r:.3g}"
    if symbol == "square":
        return f"M{x - r:.6g} {y - r:.6g}h{2 * r:.3g}v{2 * r:.3g}h{-2 * r:.3g}z"
    return f"M{x - r:.6g} {b}l{c} {-r:.3g}l{c} {c}l{-r:.3g} {c}z"
