"""Schematics of structures: chains of masses (Yang, Fig. 3), beams and plane frames (Figs. 1 and 6)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from dynid.report.drawing.structure_scene import (
    Attachments,
    Label,
    SpringDamper,
    StructureGeometry,
    attachments_of,
    geometry_of,
)
from dynid.report.figure import Figure, FigureTable, Picture
from dynid.report.scenes import estimates, scene_of
from dynid.report.svg import SMALL, Point, Svg, text_width
from dynid.result import Result
from dynid.structure.labels import node_direction, unsigned

#: Most masses of a chain, and most nodes, that are drawn.
MASSES, NODES = 40, 2000
#: Most nodes that are all numbered; of more, only the ends of members and those with an attachment.
_NUMBERED = 26
_ROW, _MASS, _LEADING, _PAD = 26.0, 64.0, 13.0, 16.0


def figures(result: Result) -> Iterator[Figure]:
    """Yield the schematic of a result's structure, where its scene defines one with a geometry."""
    geometry = plane_geometry(result)
    if geometry is not None:
        attached = attachments_of(scene_of(result), geometry.labels, estimates(result))
        yield Figure("structure", "Structure", lambda: _picture(result.title, geometry, attached))


def plane_geometry(result: Result) -> StructureGeometry | None:
    """Return the geometry of a chain, beam or plane frame that is drawn as a schematic; None of others."""
    geometry = geometry_of(scene_of(result))
    few = geometry is not None and len(geometry.points) <= (MASSES if geometry.masses else NODES)
    return geometry if few else None


def _picture(title: str, geometry: StructureGeometry, attached: Attachments) -> Picture:
    counts = (
        (sum(spring.joint for spring in attached.springs), "joint"),
        (len(attached.forces), "force"),
        (len(attached.sensors), "sensor"),
        (len(attached.masters), "master"),
    )
    parts = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count]
    about = f"The structure with {', '.join(parts)}." if parts else "The structure."
    svg = Svg("structure", f"Structure of {title}", about)
    drawing = (
        _ChainDrawing(svg, geometry, attached) if geometry.masses else _FrameDrawing(svg, geometry, attached)
    )
    rows = [
        (", ".join(map(str, tie.dofs)), "joint" if tie.joint else "link", ", ".join(tie.texts))
        for tie in attached.springs
    ]
    rows += [(str(dof), "mass", text) for dof, text in enumerate(geometry.masses, 1)]
    rows += [(str(label), "force", "") for label in attached.forces]
    rows += [(str(label), "sensor", quantity) for label, quantity in attached.sensors]
    rows += [(str(label), "master", "") for label in attached.masters]
    return Picture(drawing.render(), about, FigureTable(("DOF", "what", "value"), tuple(rows)))


class _ChainDrawing:
    """Masses in a row with their springs, dampers and attachments."""

    def __init__(self, svg: Svg, geometry: StructureGeometry, attached: Attachments) -> None:
        self.svg, self.masses, self.attached = svg, geometry.masses, attached
        count = len(self.masses)
        self.between: list[list[SpringDamper]] = [[] for _ in range(count + 1)]  # to the left of every mass
        self.below: list[list[SpringDamper]] = [[] for _ in range(count)]
        self.over: list[SpringDamper] = []
        for tie in attached.springs:
            places = sorted(int(dof) - 1 for dof in tie.dofs)
            if len(places) == 1:
                if places[0] in (0, count - 1):
                    self.between[0 if places[0] == 0 else count].append(tie)
                else:
                    self.below[places[0]].append(tie)
            elif len(places) == 2 and places[1] == places[0] + 1:
                self.between[places[1]].append(tie)
            else:
                self.over.append(tie)

    def render(self) -> str:
        rows = max((sum(map(_rows, gap)) for gap in self.between), default=1)
        texts = max((sum(len(tie.texts) for tie in gap) for gap in self.between), default=0)
        self.half = max(rows * _ROW, 44) / 2
        top = 58 + len(self.over) * 44.0
        self.y = top + self.half
        x, self.centres = _PAD, list[float]()
        for index, gap in enumerate(self.between):
            width = _PAD
            if gap or 0 < index < len(self.masses):
                width = max([70.0, *(text_width(text, SMALL) + 14 for tie in gap for text in tie.texts)])
            end = x + width
            if gap:
                self._draw_gap(gap, x, end, index)
            x = end
            if index < len(self.masses):
                self.centres.append(x + _MASS / 2)
                x += _MASS
        drop = max((sum(map(_rows, under)) for under in self.below), default=0)
        bottom = self.y + self.half + max(texts * _LEADING + 12, 100 if drop else 0, 20)
        for index in range(len(self.masses)):
            self._draw_mass(index)
        for lane, tie in enumerate(self.over):
            # Between masses that are not neighbours: above the chain.
            y, places = top - 40 - 44.0 * lane, sorted(int(dof) - 1 for dof in tie.dofs)
            left, right = self.centres[places[0]] + 10, self.centres[places[-1]] - 10
            for index in places:
                leg = min(max(self.centres[index], left), right)
                self.svg.line((leg, self.y - self.half), (leg, y), cls=_line_class(tie))
            for drawn, draw, height in ((tie.stiff, spring, y), (tie.damped, damper, y + 18)):
                if drawn:
                    draw(self.svg, (left, height), (right, height), _line_class(tie))
            self.svg.text((left + right) / 2, y - 10, ", ".join(tie.texts), tie.text_class)
        return self.svg.render(x + _PAD, bottom + _PAD)

    def _draw_gap(self, gap: Sequence[SpringDamper], left: float, right: float, index: int) -> None:
        """Draw springs and dampers between neighbours, or to ground at an end, with their values below."""
        inner = 0 < index < len(self.masses)
        if not inner:
            ground(self.svg, (left if index == 0 else right, self.y), "left" if index == 0 else "right")
        rows = sum(map(_rows, gap))
        y = self.y - (rows - 1) * _ROW / 2
        text = self.y + self.half + _LEADING
        for tie in gap:
            for drawn, draw in ((tie.stiff, spring), (tie.damped, damper)):
                if drawn:
                    draw(self.svg, (left, y), (right, y), _line_class(tie))
                    y += _ROW
            for line in tie.texts:
                self.svg.text((left + right) / 2, text, line, tie.text_class)
                text += _LEADING
        if rows > 1:
            for end in {left, right} if inner else {left if index == 0 else right}:
                reach = (rows - 1) * _ROW / 2
                self.svg.line((end, self.y - reach), (end, self.y + reach), cls="line")

    def _draw_mass(self, index: int) -> None:
        """Draw a mass with its force, sensors, and springs to ground."""
        x, svg, dof = self.centres[index], self.svg, index + 1
        for cls, more in (("paper", {}), ("node", {}), ("line", {"rx": 2})):
            svg.rect(x - _MASS / 2, self.y - self.half, _MASS, 2 * self.half, cls, **more)
        svg.text(x, self.y - 2, f"{dof}", "strong")
        mass = self.masses[index]
        if mass.endswith("?") and text_width(mass, SMALL) > _MASS:  # the table has its name
            mass = "m = ?"
        svg.text(x, self.y + 12, mass, "small muted")
        above, low = self.y - self.half, self.y + self.half
        if dof in self.attached.forces:
            force(svg, (x - 2, above - 9), (x + 26, above - 9))
            svg.line((x - 2, above), (x - 2, above - 14), cls="line")
            svg.text(x + 14, above - 18, "F", "small s2")
        quantities = [quantity for label, quantity in self.attached.sensors if label == dof]
        if quantities:
            sensor(svg, x - 20, above - 1)
            svg.text(x - 20, above - 16, ", ".join(q[0] for q in quantities), "small s3")
        if dof in self.attached.masters:
            master(svg, x - _MASS / 2 + 8, low - 8)
        under = self.below[index]
        column = x - (sum(map(_rows, under)) - 1) * 11
        for tie in under:
            for drawn, draw in ((tie.stiff, spring), (tie.damped, damper)):
                if drawn:
                    draw(svg, (column, low), (column, low + 60), _line_class(tie))
                    column += 22
            svg.text(x, low + 60 + 22, ", ".join(tie.texts), tie.text_class)
        if under:
            ground(svg, (x, low + 60), "below")


def _rows(tie: SpringDamper) -> int:
    return tie.stiff + tie.damped or 1


def _line_class(tie: SpringDamper) -> str:
    return "line mark" if tie.joint else "line"


class _FrameDrawing:
    """Members between nodes, with supports and attachments; y downwards, px."""

    def __init__(self, svg: Svg, geometry: StructureGeometry, attached: Attachments) -> None:
        self.svg, self.geometry, self.attached = svg, geometry, attached
        width, height = geometry.extent
        beam = not height and len(geometry.members) == 1
        paper = min(max(90.0 * (len(geometry.points) - 1), 480.0), 1100.0) if beam else 640.0
        scale = paper / max(width, height, 1e-12)
        xs, ys = zip(*geometry.points.values(), strict=True)
        left, top = min(xs), max(ys)
        self.points: Mapping[int, Point] = {
            node: (scale * (x - left), scale * (top - y)) for node, (x, y) in geometry.points.items()
        }
        self.middle = sum(x for x, _ in self.points.values()) / len(self.points)

    def render(self) -> str:
        svg, members, supports = self.svg, self.geometry.members, self.geometry.supports
        for nodes in members:
            svg.line(*(self.points[node] for node in nodes), cls="bond")
        labels: list[Label] = [*self.attached.forces, *self.attached.masters]
        labels += [label for label, _ in self.attached.sensors]
        labels += [dof for tie in self.attached.springs for dof in tie.dofs]
        named = {_node_of(label) for label in labels} | supports.keys()
        named |= {nodes[end] for nodes in members for end in (0, -1)}
        for node, (x, y) in self.points.items():
            svg.circle(x, y, 2.5, "solid")
            if len(self.points) <= _NUMBERED or node in named:  # the number where nothing else is drawn
                held = {_way(tie.dofs[0]) for tie in self.attached.springs if _node_of(tie.dofs[0]) == node}
                off = 22 if "rz" in held or node in supports else 15 if held else 6
                inwards = "x" in held and x > self.middle  # a spring to ground is on the right
                text_x, anchor = (x - 6, "end") if inwards else (x + off, "start")
                svg.text(text_x, y + 14, str(node), "small muted", anchor=anchor)
        for node in self.geometry.carrying:
            svg.circle(*self.points[node], 7, "solid")
        for node, fixed in supports.items():
            self._draw_support(node, fixed)
        for tie in self.attached.springs:
            self._draw_spring(tie)
        self._draw_loads_and_sensors()
        xs, ys = zip(*self.points.values(), strict=True)
        side_texts = [text for tie in self.attached.springs if len(tie.dofs) == 1 for text in tie.texts]
        side = max([90.0, *(text_width(text, SMALL) + 34 for text in side_texts)])
        left, right, top = min(xs) - side, max(xs) + side, min(ys) - 80
        return svg.render(right - left, max(ys) + 110 - top, left, top)

    def _draw_support(self, node: int, fixed: Sequence[str]) -> None:
        """Draw a clamp, a guide or a pin; the ground of a clamp is below a member that rises steeply."""
        x, y = self.points[node]
        if "theta" in fixed and len(fixed) > 1:
            below = False
            for nodes in self.geometry.members:
                for end, inner in ((nodes[0], nodes[1]), (nodes[-1], nodes[-2])):
                    x2, y2 = self.points[inner]
                    below = below or (end == node and y - y2 > abs(x2 - x))
            clamp(self.svg, x, y, "below" if below else "left" if x <= self.middle else "right")
        elif "theta" in fixed:
            guide(self.svg, x, y)
        else:
            pin(self.svg, x, y)

    def _draw_spring(self, tie: SpringDamper) -> None:
        """Draw a spring and damper: around its node, to ground, or below two nodes."""
        svg, cls = self.svg, _line_class(tie)
        nodes = [_node_of(dof) for dof in tie.dofs]
        (x, y), (x2, y2) = self.points[nodes[0]], self.points[nodes[-1]]
        if len(nodes) == 1 and _way(tie.dofs[0]) == "rz":
            # A rotational spring: a spiral around the node, down to ground.
            spiral = "m-2 0 a5 5 0 1 1 7 5 a11 11 0 1 1 7 -12 a17 17 0 0 1 -10 22"
            svg.element("path", cls, d=f"M{x:.1f} {y:.1f} {spiral}")
            for number, text in enumerate(tie.texts):
                svg.text(x - 24, y + 16 + _LEADING * number, text, tie.text_class, anchor="end")
            return
        if len(nodes) == 1:
            self._draw_spring_to_ground(tie, x, y)
            return
        y_low = max(y, y2) + 46
        svg.line((x, y), (x, y_low), cls=cls)
        svg.line((x2, y2), (x2, y_low), cls=cls)
        if x == x2:
            return
        for drawn, draw, off in ((tie.stiff, spring, 0), (tie.damped, damper, 18)):
            if drawn:
                draw(svg, (x, y_low - off), (x2, y_low - off), cls)
        svg.text((x + x2) / 2, y_low + 18, ", ".join(tie.texts), tie.text_class)

    def _draw_spring_to_ground(self, tie: SpringDamper, x: float, y: float) -> None:
        """Draw a spring and damper from a node to ground: downwards, or sideways out of the structure."""
        svg, cls, out = self.svg, _line_class(tie), -1 if x <= self.middle else 1
        sideways = _way(tie.dofs[0]) == "x"
        apart = 10 if tie.stiff and tie.damped else 0
        for drawn, draw, off in ((tie.stiff, spring, -apart), (tie.damped, damper, apart)):
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
        for number, text in enumerate(tie.texts):
            svg.text(x + side, y + 36 + _LEADING * number, text, tie.text_class, anchor=anchor)

    def _draw_loads_and_sensors(self) -> None:
        """Draw forces, sensors and masters above their nodes, their texts one over another."""
        counts: dict[int, int] = {}

        def write(node: int, text: str, cls: str) -> None:
            x, y = self.points[node]
            row = counts.get(node, 0)
            counts[node] = row + 1
            self.svg.text(x, y - 44 - _LEADING * row, text, f"small {cls}")

        for label in self.attached.forces:
            x, y = self.points[_node_of(label)]
            along = _way(label)
            # As it acts where its signal is positive.
            start, end = ((x - 44, y - 14), (x - 7, y - 14)) if along == "x" else ((x, y - 5), (x, y - 38))
            force(self.svg, *((start, end) if unsigned(label) == label else (end, start)))
            write(_node_of(label), f"{'M' if along == 'rz' else 'F'} at {label}", "s2")
        for label, quantity in self.attached.sensors:
            x, y = self.points[_node_of(label)]
            sensor(self.svg, x + 12, y - 4)
            write(_node_of(label), f"{quantity} {label}", "s3")
        for label in self.attached.masters:
            master(self.svg, *self.points[_node_of(label)])


def _node_of(label: Label) -> int:
    """Return the node of a DOF: 4 of w_4 and of 4:-y."""
    return int((node_direction(unsigned(label)) or (0, ""))[0])


def _way(label: Label) -> str:
    """Return the direction of a DOF: y of w_4 and of 4:-y."""
    return (node_direction(unsigned(label)) or (0, ""))[1]


_WIND, _TURNS = 6.0, 5


def spring(svg: Svg, start: Point, end: Point, cls: str = "line") -> None:
    """Draw a spring between two points."""
    points = [_offset(start, end, 0, 0), _offset(start, end, 0.2, 0)]
    for turn in range(2 * _TURNS):
        side = _WIND if turn % 2 else -_WIND
        points.append(_offset(start, end, 0.2 + 0.6 * (turn + 0.5) / (2 * _TURNS), side))
    svg.line(*points, _offset(start, end, 0.8, 0), _offset(start, end, 1, 0), cls=cls)


def damper(svg: Svg, start: Point, end: Point, cls: str = "line") -> None:
    """Draw a dashpot between two points."""
    cup = [(0.66, -_WIND), (0.38, -_WIND), (0.38, _WIND), (0.66, _WIND)]
    svg.line(_offset(start, end, 0, 0), _offset(start, end, 0.38, 0), cls=cls)
    svg.line(*(_offset(start, end, *corner) for corner in cup), cls=cls)
    svg.line(_offset(start, end, 0.54, -_WIND + 2), _offset(start, end, 0.54, _WIND - 2), cls=cls)
    svg.line(_offset(start, end, 0.54, 0), _offset(start, end, 1, 0), cls=cls)


def ground(svg: Svg, at: Point, side: str) -> None:
    """Draw hatched ground to the `left`, to the `right` or `below` a point."""
    x, y = at
    reach = 16.0
    if side == "below":
        svg.line((x - reach, y), (x + reach, y), cls="line")
        for step in range(5):
            a = x - reach + 4 + 7 * step
            svg.line((a, y), (a - 5, y + 7), cls="hair")
        return
    out = -6.0 if side == "left" else 6.0
    svg.line((x, y - reach), (x, y + reach), cls="line")
    for step in range(5):
        b = y - reach + 2 + 7 * step
        svg.line((x, b), (x + out, b + 6), cls="hair")


def pin(svg: Svg, x: float, y: float) -> None:
    """Draw a pinned support under a point."""
    svg.polygon((x, y + 3), (x - 10, y + 19), (x + 10, y + 19), cls="line")
    ground(svg, (x, y + 19), "below")


def clamp(svg: Svg, x: float, y: float, side: str) -> None:
    """Draw a clamped end at a point, with the ground to its `left`, to its `right` or `below`."""
    ground(svg, (x, y), side)
    svg.rect(*((x - 16, y - 2, 32, 4) if side == "below" else (x - 2, y - 16, 4, 32)), "solid")


def guide(svg: Svg, x: float, y: float) -> None:
    """Draw a support that fixes the rotation only: two rails."""
    for out in (-5, 5):
        svg.line((x + out, y - 12), (x + out, y + 12), cls="line")


def force(svg: Svg, start: Point, end: Point) -> None:
    """Draw a force as an arrow."""
    svg.arrow(start, end, cls="bond s2", head="s2 dot")


def sensor(svg: Svg, x: float, y: float) -> None:
    """Draw a sensor: a triangle that points down at its node."""
    svg.polygon((x, y), (x - 6, y - 10), (x + 6, y - 10), cls="s3 dot")


def master(svg: Svg, x: float, y: float) -> None:
    """Draw the mark of a master DOF of a reduction."""
    svg.rect(x - 4, y - 4, 8, 8, "s1 dot")


def _offset(start: Point, end: Point, share: float, aside: float) -> Point:
    """Return the point at a part of a line and an offset aside, px."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = max((dx * dx + dy * dy) ** 0.5, 1e-9)
    return start[0] + share * dx - dy * aside / length, start[1] + share * dy + dx * aside / length
