"""A chain of masses as a schematic, as Yang's Fig. 3."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.report.drawing.mounting import Fastening, Mounted
from dynid.report.drawing.symbols import damper, force, ground, master, sensor, spring
from dynid.report.metrics import text_width
from dynid.report.numbers import short
from dynid.report.style import SMALL
from dynid.report.svg import Svg

_ROW, _MASS, _LEADING, _PAD = 26.0, 64.0, 13.0, 16.0


def draw_lumped(svg: Svg, masses: Sequence[float], mounted: Mounted) -> str:
    """Draw masses in a row with what ties them; return the figure."""
    return _Chain(svg, masses, mounted).draw()


class _Chain:
    def __init__(self, svg: Svg, masses: Sequence[float], mounted: Mounted) -> None:
        self.svg, self.masses, self.mounted = svg, masses, mounted
        count = len(masses)
        self.between: list[list[Fastening]] = [[] for _ in range(count + 1)]  # to the left of every mass
        self.below: list[list[Fastening]] = [[] for _ in range(count)]
        self.over: list[Fastening] = []
        for fastening in mounted.fastenings:
            places = sorted(int(dof) - 1 for dof in fastening.dofs)
            if len(places) == 1:
                if places[0] in (0, count - 1):
                    self.between[0 if places[0] == 0 else count].append(fastening)
                else:
                    self.below[places[0]].append(fastening)
            elif len(places) == 2 and places[1] == places[0] + 1:
                self.between[places[1]].append(fastening)
            else:
                self.over.append(fastening)

    def draw(self) -> str:
        """Draw everything and return the figure."""
        rows = max((sum(_rows(f) for f in gap) for gap in self.between), default=1)
        texts = max((sum(len(f.texts) for f in gap) for gap in self.between), default=0)
        self.half = max(rows * _ROW, 44) / 2
        lanes = len(self.over)
        top = 58 + lanes * 44.0
        self.y = top + self.half
        x, self.centres = _PAD, list[float]()
        for place, gap in enumerate(self.between):
            width = self._width(gap) if gap or 0 < place < len(self.masses) else _PAD
            end = x + width
            if gap:
                self._gap(gap, x, end, place)
            x = end
            if place < len(self.masses):
                self.centres.append(x + _MASS / 2)
                x += _MASS
        drop = max((sum(_rows(f) for f in under) for under in self.below), default=0)
        bottom = self.y + self.half + max(texts * _LEADING + 12, 100 if drop else 0, 20)
        for place in range(len(self.masses)):
            self._mass(place)
        for lane, fastening in enumerate(self.over):
            self._bridge(fastening, top - 40 - 44.0 * lane)
        return self.svg.render(x + _PAD, bottom + _PAD)

    def _width(self, gap: Sequence[Fastening]) -> float:
        texts = [text_width(text, SMALL) for fastening in gap for text in fastening.texts]
        return max([70.0, *(width + 14 for width in texts)])

    def _gap(self, gap: Sequence[Fastening], left: float, right: float, place: int) -> None:
        """Draw springs and dampers between neighbours, or to ground at an end, with their values below."""
        if place in (0, len(self.masses)):
            ground(self.svg, (left if place == 0 else right, self.y), "left" if place == 0 else "right")
        rows = sum(map(_rows, gap))
        y = self.y - (rows - 1) * _ROW / 2
        text = self.y + self.half + _LEADING
        for fastening in gap:
            cls = "line mark" if fastening.joint else "line"
            for drawn, draw in ((fastening.stiff, spring), (fastening.damped, damper)):
                if drawn:
                    draw(self.svg, (left, y), (right, y), cls)
                    y += _ROW
            for line in fastening.texts:
                marked = "small marked" if fastening.joint else "small"
                self.svg.text((left + right) / 2, text, line, marked)
                text += _LEADING
        if rows > 1:
            for end in {left, right} if 0 < place < len(self.masses) else {left if place == 0 else right}:
                reach = (rows - 1) * _ROW / 2
                self.svg.line((end, self.y - reach), (end, self.y + reach), cls="line")

    def _mass(self, place: int) -> None:
        x, svg, dof = self.centres[place], self.svg, place + 1
        svg.rect(x - _MASS / 2, self.y - self.half, _MASS, 2 * self.half, "paper")
        svg.rect(x - _MASS / 2, self.y - self.half, _MASS, 2 * self.half, "node")
        svg.rect(x - _MASS / 2, self.y - self.half, _MASS, 2 * self.half, "line", rx=2)
        svg.text(x, self.y - 2, f"{dof}", "strong")
        svg.text(x, self.y + 12, f"{short(self.masses[place])} kg", "small muted")
        above = self.y - self.half
        if dof in self.mounted.forces:
            force(svg, (x - 2, above - 9), (x + 26, above - 9))
            svg.line((x - 2, above), (x - 2, above - 14), cls="line")
            svg.text(x + 14, above - 18, "F", "small s2")
        quantities = [quantity for label, quantity in self.mounted.sensors if label == dof]
        if quantities:
            sensor(svg, x - 20, above - 1)
            svg.text(x - 20, above - 16, ", ".join(q[0] for q in quantities), "small s3")
        if dof in self.mounted.masters:
            master(svg, x - _MASS / 2 + 8, self.y + self.half - 8)
        self._drop(self.below[place], x)

    def _drop(self, under: Sequence[Fastening], x: float) -> None:
        """Draw what ties an inner mass to ground."""
        rows = sum(map(_rows, under))
        a, b = self.y + self.half, self.y + self.half + 60
        column = x - (rows - 1) * 11
        for fastening in under:
            for drawn, draw in ((fastening.stiff, spring), (fastening.damped, damper)):
                if drawn:
                    draw(self.svg, (column, a), (column, b), "line mark" if fastening.joint else "line")
                    column += 22
            self.svg.text(
                x, b + 22, ", ".join(fastening.texts), "small marked" if fastening.joint else "small"
            )
        if under:
            ground(self.svg, (x, b), "below")

    def _bridge(self, fastening: Fastening, y: float) -> None:
        """Draw what ties masses that are no neighbours."""
        places = sorted(int(dof) - 1 for dof in fastening.dofs)
        left, right = self.centres[places[0]] + 10, self.centres[places[-1]] - 10
        cls = "line mark" if fastening.joint else "line"
        for place in places:
            x = min(max(self.centres[place], left), right)
            self.svg.line((x, self.y - self.half), (x, y), cls=cls)
        for drawn, draw, height in ((fastening.stiff, spring, y), (fastening.damped, damper, y + 18)):
            if drawn:
                draw(self.svg, (left, height), (right, height), cls)
        text = ", ".join(fastening.texts)
        self.svg.text((left + right) / 2, y - 10, text, "small marked" if fastening.joint else "small")


def _rows(fastening: Fastening) -> int:
    return fastening.stiff + fastening.damped or 1
