"""Draw docs/architecture.svg, the packages and their imports: `python docs/architecture.py`.

The layers are those of `tests/test_layers.py`. A package is a box whose area grows with its lines; a line
leads from a package down to one that it imports, as thick as there are imports. Of the lowest layer, which
every package imports, no lines are drawn. Lines pass behind the boxes on their way.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from dynid.report.svg import Svg  # noqa: E402
from tests.test_layers import LAYERS, ROOT, edges, modules, package_of  # noqa: E402

PICTURE = HERE / "architecture.svg"
WIDTH, MARGIN, GAP = 940.0, 12.0, 30.0
#: Height of a thousand lines over the whole width; the least height of a layer and width of a box.
THOUSAND, LOW, NARROW = 8.5, 26.0, 74.0
LETTER = 5.6  # mean width of a small letter
PLAIN = "s7"
INSET = 10.0  # of lines from the corners of their boxes
#: Colours of the packages that import most, such that lines side by side differ; the others are grey.
COLOURS = dict(
    zip(
        ("cli", "report", "bench", "study", "scene", "identification", "bondgraph", "structure"),
        ("s4", "s5", "s6", "s3", "s1", "s2", "s3", "s4"),
        strict=True,
    )
)

LINES = Counter[str]()
for module in modules():
    place = ROOT.joinpath(*module.split("."))
    file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    LINES[package_of(module)] += len(file.read_text().splitlines())
IMPORTS = Counter(
    (package_of(module), package_of(name))
    for module, name in edges()
    if not any({package_of(module), package_of(name)} <= layer for layer in LAYERS)
    and package_of(name) not in {"dynid", *LAYERS[0]}
)


class Box(NamedTuple):
    """A package where it stands."""

    name: str
    layer: int
    x: float
    y: float
    width: float
    height: float


def boxes() -> dict[str, Box]:
    """Return all packages, layer by layer from the top."""
    found, y = {}, MARGIN
    for number in reversed(range(len(LAYERS))):
        names = sorted(LAYERS[number] & set(LINES), key=lambda name: (LINES[name] >= 1000, name))
        total = sum(LINES[name] for name in names)
        height = max(LOW, THOUSAND * total / 1000)
        x = MARGIN
        for name, width in zip(names, _widths(names), strict=True):
            found[name] = Box(name, number, x, y, width, height)
            x += width + 4
        y += height + GAP
    return found


def _widths(names: list[str]) -> list[float]:
    """Share a layer by lines, but leave room for every name."""
    room = WIDTH - 2 * MARGIN - 4 * (len(names) - 1)
    spare = room - NARROW * len(names)
    total = sum(LINES[name] for name in names)
    return [NARROW + spare * LINES[name] / total for name in names]


def lanes(found: dict[str, Box]) -> dict[tuple[str, str], float]:
    """Return an abscissa for every line, within both of its boxes and clear of the others."""
    taken: list[float] = []
    placed = {}

    def room(pair: tuple[str, str]) -> tuple[float, float]:
        a, b = (found[name] for name in pair)
        low, high = max(a.x, b.x), min(a.x + a.width, b.x + b.width)
        low, high = (low, high) if high - low > 3 * INSET else (b.x, b.x + b.width)
        return low + INSET, high - INSET

    for pair in sorted(IMPORTS, key=lambda pair: (room(pair)[1] - room(pair)[0], pair)):
        low, high = room(pair)
        count = max(2, int((high - low) / 3))
        free = [low + (high - low) * (k + 0.5) / count for k in range(count)]
        placed[pair] = max(free, key=lambda x: (min([abs(x - other) for other in taken], default=WIDTH), -x))
        taken.append(placed[pair])
    return placed


def parts_of(package: str) -> list[str]:
    """Return the folders within a package, the largest first."""
    sizes = Counter[str]()
    for module in modules():
        names = module.split(".")
        if names[0] == package and len(names) > 1 and (ROOT / package / names[1]).is_dir():
            sizes[names[1]] += 1
    return [name for name, _ in sizes.most_common()]


def draw() -> str:
    """Return the picture."""
    found = boxes()
    svg = Svg(
        "architecture",
        "The packages of dynid in their layers",
        "Each package imports only layers below its own: "
        + "; ".join(f"{package} imports {other}" for package, other in sorted(IMPORTS)),
    )
    for (package, other), x in lanes(found).items():
        a, b, colour = found[package], found[other], COLOURS.get(package, PLAIN)
        start, end = min(max(x, a.x + INSET), a.x + a.width - INSET), x
        y0, y1 = a.y + a.height, b.y - 1
        thick = 0.8 + 0.45 * math.log2(IMPORTS[package, other])
        svg.open(tip=f"{package} imports {other}: {IMPORTS[package, other]}")
        points = ((start, y0), (start, y0 + 8), (end, y0 + 14), (end, y1 - 6))
        svg.line(*points, cls=colour, style=f"stroke-width: {thick:.2g}", data_edge=f"{package} {other}")
        svg.polygon((end, y1), (end - 4, y1 - 8), (end + 4, y1 - 8), cls=f"{colour} dot")
        svg.close()
    for box in found.values():
        _draw_box(svg, box, COLOURS.get(box.name, PLAIN))
    bottom = max(box.y + box.height for box in found.values())
    return svg.render(WIDTH, bottom + MARGIN)


def _draw_box(svg: Svg, box: Box, colour: str) -> None:
    shape = {"x": box.x, "y": box.y, "width": box.width, "height": box.height}
    svg.rect(*shape.values(), cls="paper", rx=3)
    svg.rect(*shape.values(), cls=f"{colour} fine", rx=3, data_package=box.name, data_lines=LINES[box.name])
    svg.rect(*shape.values(), cls=f"{colour} band", rx=3)
    middle = box.y + 17
    svg.text(box.x + 8, middle, box.name, "strong", anchor="start")
    used = 8 + 7.4 * len(box.name) + 8
    size = f"{LINES[box.name]:,} lines"
    if box.width > used + LETTER * len(size) + 8:
        svg.text(box.x + box.width - 8, middle, size, "small muted", anchor="end")
    inside = parts_of(box.name)
    if inside and box.height > 2 * LOW:
        for row, text in enumerate(_filled(inside, box.width - 16)):
            svg.text(box.x + 8, middle + 17 + 14 * row, text, "small muted", anchor="start")
    elif inside and (text := ", ".join(inside)) and box.width > used + LETTER * (len(text) + len(size)) + 30:
        svg.text(box.x + used + 8, middle, text, "small muted", anchor="start")


def _filled(words: list[str], width: float) -> list[str]:
    """Break a list of words into lines."""
    rows = [""]
    for word in words:
        longer = f"{rows[-1]}, {word}" if rows[-1] else word
        if LETTER * len(longer) > width and rows[-1]:
            rows.append(word)
        else:
            rows[-1] = longer
    return rows


if __name__ == "__main__":
    PICTURE.write_text(draw())
