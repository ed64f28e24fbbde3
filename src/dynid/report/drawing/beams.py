"""Beams and plane frames as schematics, as Yang's Figs. 1 and 6."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from dynid.report.drawing.mounting import Fastening, Mounted
from dynid.report.drawing.shape import Label
from dynid.report.drawing.symbols import (
    clamp,
    damper,
    force,
    ground,
    guide,
    master,
    pin,
    sensor,
    spring,
    turning_spring,
)
from dynid.report.svg import Point, Svg

#: Nodes that are all numbered; of more only those with something on them.
_NUMBERED = 26
_LEADING = 13.0


def draw_members(
    svg: Svg,
    points: Mapping[int, Point],
    members: Sequence[Sequence[int]],
    supports: Mapping[int, Sequence[str]],
    masses: Sequence[int],
    mounted: Mounted,
) -> str:
    """Draw members between nodes, and what is fixed to the nodes; return the figure.

    Parameters
    ----------
    svg
        The figure.
    points
        The place of every node, px.
    members
        The nodes along every member.
    supports
        The directions that are fixed, by node.
    masses
        Nodes with a point mass.
    mounted
        What else is fixed.
    """
    return _Members(svg, points, mounted).draw(members, supports, masses)


class _Members:
    def __init__(self, svg: Svg, points: Mapping[int, Point], mounted: Mounted) -> None:
        self.svg, self.points, self.mounted = svg, points, mounted
        self.lowest = max(y for _, y in points.values())
        self.middle = sum(x for x, _ in points.values()) / len(points)

    def draw(
        self, members: Sequence[Sequence[int]], supports: Mapping[int, Sequence[str]], masses: Sequence[int]
    ) -> str:
        """Draw everything and return the figure."""
        svg = self.svg
        for nodes in members:
            svg.line(*(self.points[node] for node in nodes), cls="bond")
        busy = self._busy() | supports.keys() | {nodes[end] for nodes in members for end in (0, -1)}
        for node, (x, y) in self.points.items():
            svg.circle(x, y, 2.5, "solid")
            if len(self.points) <= _NUMBERED or node in busy:
                self._number(node, supports)
        for node in masses:
            svg.circle(*self.points[node], 7, "solid")
        standing = {node for nodes in members for node in self._feet(nodes)}
        for node, fixed in supports.items():
            self._support(node, fixed, node in standing)
        for fastening in self.mounted.fastenings:
            self._fasten(fastening)
        self._above()
        xs, ys = zip(*self.points.values(), strict=True)
        left, right, top = min(xs) - 90, max(xs) + 90, min(ys) - 80
        return svg.render(right - left, self.lowest + 110 - top, left, top)

    def _number(self, node: int, supports: Mapping[int, Sequence[str]]) -> None:
        """Write the number of a node where nothing else is drawn."""
        x, y = self.points[node]
        held = {f.dofs[0] for f in self.mounted.fastenings if node_of(f.dofs[0]) == node}
        off = 22 if f"theta_{node}" in held or node in supports else 15 if held else 6
        inwards = f"u_{node}" in held and x > self.middle  # a spring to ground stands on the right
        place, anchor = (x - 6, "end") if inwards else (x + off, "start")
        self.svg.text(place, y + 14, str(node), "small muted", anchor=anchor)

    def _busy(self) -> set[int]:
        labels: list[Label] = [*self.mounted.forces, *self.mounted.masters]
        labels += [label for label, _ in self.mounted.sensors]
        labels += [dof for fastening in self.mounted.fastenings for dof in fastening.dofs]
        return {node_of(label) for label in labels}

    def _feet(self, nodes: Sequence[int]) -> Iterator[int]:
        """Yield the ends from which a member goes rather up than sideways."""
        for end, next_one in ((nodes[0], nodes[1]), (nodes[-1], nodes[-2])):
            (x, y), (x2, y2) = self.points[end], self.points[next_one]
            if y - y2 > abs(x2 - x):
                yield end

    def _support(self, node: int, fixed: Sequence[str], standing: bool) -> None:
        x, y = self.points[node]
        if "theta" in fixed and len(fixed) > 1:
            clamp(self.svg, x, y, "below" if standing else "left" if x <= self.middle else "right")
        elif "theta" in fixed:
            guide(self.svg, x, y)
        else:
            pin(self.svg, x, y)

    def _fasten(self, fastening: Fastening) -> None:
        """Draw a joint: to ground below its node, around it, or between two nodes."""
        svg, cls = self.svg, "line mark" if fastening.joint else "line"
        nodes = [node_of(dof) for dof in fastening.dofs]
        (x, y), (x2, y2) = self.points[nodes[0]], self.points[nodes[-1]]
        marked = "small marked" if fastening.joint else "small"
        if len(nodes) == 1 and str(fastening.dofs[0]).startswith("theta"):
            turning_spring(svg, x, y, cls)
            for number, text in enumerate(fastening.texts):
                svg.text(x - 24, y + 16 + _LEADING * number, text, marked, anchor="end")
            return
        if len(nodes) == 1:
            self._to_ground(fastening, x, y, cls)
            return
        y_low = max(y, y2) + 46
        svg.line((x, y), (x, y_low), cls=cls)
        svg.line((x2, y2), (x2, y_low), cls=cls)
        if x == x2:
            return
        for drawn, draw, off in ((fastening.stiff, spring, 0), (fastening.damped, damper, 18)):
            if drawn:
                draw(svg, (x, y_low - off), (x2, y_low - off), cls)
        svg.text((x + x2) / 2, y_low + 18, ", ".join(fastening.texts), marked)

    def _to_ground(self, fastening: Fastening, x: float, y: float, cls: str) -> None:
        """Draw a spring and damper from a node to ground: downwards, or sideways out of the structure."""
        svg, out = self.svg, -1 if x <= self.middle else 1
        sideways = str(fastening.dofs[0]).startswith("u")
        apart = 10 if fastening.stiff and fastening.damped else 0
        for drawn, draw, off in (
            (fastening.stiff, spring, -apart),
            (fastening.damped, damper, apart),
        ):
            if drawn and sideways:
                draw(svg, (x + 3 * out, y + off), (x + 60 * out, y + off), cls)
            elif drawn:
                draw(svg, (x + off, y + 3), (x + off, y + 63), cls)
        if sideways:
            svg.line((x + 3 * out, y - apart), (x + 3 * out, y + apart), cls=cls)
            ground(svg, (x + 60 * out, y), "left" if out < 0 else "right")
        else:
            svg.line((x - apart, y + 3), (x + apart, y + 3), cls=cls)
            ground(svg, (x, y + 63), "below")
        side, anchor = (24 * out, "end" if out < 0 else "start") if sideways else (24, "start")
        for number, text in enumerate(fastening.texts):
            marked = "small marked" if fastening.joint else "small"
            svg.text(x + side, y + 36 + _LEADING * number, text, marked, anchor=anchor)

    def _above(self) -> None:
        """Draw forces, sensors and masters over their nodes."""
        texts: dict[int, int] = {}
        for label in self.mounted.forces:
            x, y = self.points[node_of(label)]
            turning, sideways = (str(label).startswith(along) for along in ("theta", "u"))
            if sideways:
                force(self.svg, (x - 44, y - 14), (x - 7, y - 14))
            else:
                force(self.svg, (x, y - 38), (x, y - 5))
            self._text(texts, node_of(label), f"{'M' if turning else 'F'} at {label}", "s2")
        for label, quantity in self.mounted.sensors:
            x, y = self.points[node_of(label)]
            sensor(self.svg, x + 12, y - 4)
            self._text(texts, node_of(label), f"{quantity} {label}", "s3")
        for label in self.mounted.masters:
            master(self.svg, *self.points[node_of(label)])

    def _text(self, texts: dict[int, int], node: int, text: str, cls: str) -> None:
        x, y = self.points[node]
        row = texts.get(node, 0)
        texts[node] = row + 1
        self.svg.text(x, y - 44 - _LEADING * row, text, f"small {cls}")


def node_of(label: Label) -> int:
    """Return the node of a DOF: 4 of w_4."""
    return int(str(label).rpartition("_")[2])
