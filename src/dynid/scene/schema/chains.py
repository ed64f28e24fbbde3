"""Chains of bonds as scenes write them."""

from __future__ import annotations


def chain_ends(text: str) -> list[str]:
    """Return the nodes along `a -> b -> c`; none where the text is no chain."""
    ends = [part.strip() for part in text.split("->")]
    return ends if len(ends) > 1 and all(ends) else []
