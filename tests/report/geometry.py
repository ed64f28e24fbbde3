"""Overlaps and crossings of a laid out drawing, computed from the drawing alone."""

from itertools import combinations, pairwise


def overlaps(sketch, layout):
    """Return the overlaps of a drawing: texts, nodes, bonds, strokes, arrows."""
    found = []
    boxes = {key: (box.left, box.top, box.right, box.bottom) for key, box in layout.boxes.items()}
    for (a, one), (b, other) in combinations(boxes.items(), 2):
        if meet(one, other):
            found.append(f"nodes {a} and {b}")
    lines = [
        list(pairwise(bond.line_on(route))) for bond, route in zip(sketch.bonds, layout.routes, strict=True)
    ]
    marks = [
        [mark for mark in (bond.stroke_on(route), *pairwise(bond.arrow_on(route))) if mark is not None]
        for bond, route in zip(sketch.bonds, layout.routes, strict=True)
    ]
    for bond, pieces in zip(sketch.bonds, [a + b for a, b in zip(lines, marks, strict=True)], strict=True):
        for key, box in boxes.items():
            if any(enters(piece, box) for piece in pieces):
                found.append(f"bond {bond.tail} -> {bond.head} and node {key}")
    for (i, one), (j, other) in combinations(enumerate(marks), 2):
        if any(meet(around(a), around(b)) for a in one for b in other):
            found.append(f"marks of bonds {i} and {j}")
    for i, own in enumerate(marks):
        for j, pieces in enumerate(lines):
            if i != j and any(crosses(mark, piece) for mark in own for piece in pieces):
                found.append(f"mark of bond {i} and bond {j}")
    for node in sketch.nodes:
        left, top, right, bottom = boxes[node.key]
        if right - left < max(line.width for line in node.lines):
            found.append(f"the text of {node.key} and its border")
        if bottom - top < sum(line.height for line in node.lines):
            found.append(f"the lines of {node.key} and its border")
    return found


def crossings(sketch, layout):
    """Return the number of pairs of bonds that cross or touch."""
    lines = [
        list(pairwise(bond.line_on(route))) for bond, route in zip(sketch.bonds, layout.routes, strict=True)
    ]
    return sum(any(crosses(a, b) for a in one for b in other) for one, other in combinations(lines, 2))


def ends(sketch, layout):
    """Return the bonds that do not begin and end at the borders of their nodes."""
    loose = []
    for bond, route in zip(sketch.bonds, layout.routes, strict=True):
        for key, (x, y) in ((bond.tail, route[0]), (bond.head, route[-1])):
            box = layout.boxes[key]
            inside = box.left - 0.01 <= x <= box.right + 0.01 and box.top - 0.01 <= y <= box.bottom + 0.01
            border = min(abs(x - box.left), abs(x - box.right), abs(y - box.top), abs(y - box.bottom))
            if not inside or border > 0.01:
                loose.append((bond.tail, bond.head, key))
    return loose


def around(segment):
    (x1, y1), (x2, y2) = segment
    return min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2)


def meet(a, b):
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]


def enters(segment, box):
    """Return True if a segment meets a closed box (Liang & Barsky)."""
    (x1, y1), (x2, y2) = segment
    first, last = 0.0, 1.0
    for start, step, low, high in ((x1, x2 - x1, box[0], box[2]), (y1, y2 - y1, box[1], box[3])):
        if step == 0:
            if not low <= start <= high:
                return False
            continue
        a, b = sorted(((low - start) / step, (high - start) / step))
        first, last = max(first, a), min(last, b)
    return first <= last


def crosses(one, other):
    """Return True if two closed segments have a point in common."""
    (a, b), (c, d) = one, other

    def side(p, q, r):
        value = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        return 0 if abs(value) < 1e-9 else (1 if value > 0 else -1)

    if not meet(around(one), around(other)):
        return False
    return side(a, b, c) * side(a, b, d) <= 0 and side(c, d, a) * side(c, d, b) <= 0
