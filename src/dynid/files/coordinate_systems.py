"""Coordinate systems of FE programs and modal tests: Cartesian, cylindrical or spherical."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from dynid.arrays import Array


class CoordinateSystem(NamedTuple):
    """A coordinate system: origin (3), axes (3 x 3, rows) in basic coordinates, and its kind."""

    origin: Array
    axes: Array
    kind: Literal["cartesian", "cylindrical", "spherical"] = "cartesian"

    def basic(self, position: Array) -> Array:
        """Return the basic coordinates of a point that is given in the system's own (angles in degrees)."""
        a, b, c = position
        if self.kind == "cylindrical":
            turn = np.radians(b)
            position = np.array([a * np.cos(turn), a * np.sin(turn), c])
        elif self.kind == "spherical":
            down, turn = np.radians(b), np.radians(c)
            across = a * np.sin(down)
            position = np.array([across * np.cos(turn), across * np.sin(turn), a * np.cos(down)])
        return np.asarray(self.origin + position @ self.axes)

    def on_axis(self, point: Array) -> bool:
        """Return True of a point on the axis of a cylindrical system, where no direction is radial."""
        distance = float(np.hypot(*(self.axes @ (point - self.origin))[:2]))
        return self.kind == "cylindrical" and (
            not distance or distance <= 1e-12 * float(np.abs(point - self.origin).max(initial=0.0))
        )

    def at(self, point: Array) -> Array:
        """Return the directions of the system (3 x 3, rows) at a point in basic coordinates.

        On the axis the angle is 0.
        """
        if self.kind == "cartesian":
            return self.axes
        x, y, z = self.axes @ (point - self.origin)
        across = np.hypot(x, y)
        c, s = (x / across, y / across) if across > 0 else (1.0, 0.0)
        if self.kind == "cylindrical":
            return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ self.axes
        down = np.arctan2(across, z) if across or z else 0.0
        cd, sd = np.cos(down), np.sin(down)
        return np.array([[sd * c, sd * s, cd], [cd * c, cd * s, -sd], [-s, c, 0.0]]) @ self.axes


BASIC = CoordinateSystem(np.zeros(3), np.eye(3))
"""The basic coordinate system."""
