"""Integers modulo a large prime: they tell zero from nonzero without any growth."""

from __future__ import annotations

from dynid.bondgraph.program import PRIME


class Modular:
    """An integer modulo `PRIME`."""

    __slots__ = ("image",)

    def __init__(self, image: int) -> None:
        self.image = image

    def __add__(self, other: Modular) -> Modular:
        return Modular((self.image + other.image) % PRIME)

    def __sub__(self, other: Modular) -> Modular:
        return Modular((self.image - other.image) % PRIME)

    def __mul__(self, other: Modular | int) -> Modular:
        factor = other.image if isinstance(other, Modular) else other
        return Modular(self.image * factor % PRIME)

    def __truediv__(self, other: Modular) -> Modular:
        if not other.image:
            raise ZeroDivisionError
        return Modular(self.image * pow(other.image, -1, PRIME) % PRIME)

    def __neg__(self) -> Modular:
        return Modular(-self.image % PRIME)
