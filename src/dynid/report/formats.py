"""Figures as files: standalone SVG, PNG and PDF."""

from __future__ import annotations

import re

from dynid.errors import UsageError
from dynid.report.style import COLOURS, resolved

#: Pixels of a PNG per inch; the unit of a figure is 1/96 inch.
_PPI = 192
_HEAD = re.compile(r'<svg\b[^>]*\bviewBox="([^"]*)"[^>]*>')
#: A page of the size of the figure, without a date, so that equal figures are equal bytes.
_PAGE = b"""#set document(date: none)
#set page(width: auto, height: auto, margin: 0pt, fill: white)
#image(bytes(sys.inputs.svg), format: "svg")
"""


def as_file(svg: str, form: str) -> bytes:
    """Return a figure as the content of a file.

    Parameters
    ----------
    svg
        The figure.
    form
        ``svg``, ``png`` or ``pdf``.

    Returns
    -------
    bytes
        In light colours on white. PNG and PDF use the fonts of the machine.

    Raises
    ------
    UsageError
        Where typst, which writes PNG and PDF, is not installed.
    """
    alone = standalone(svg)
    if form == "svg":
        return alone.encode()
    try:
        import typst
    except ImportError:
        problem = f"figures as {form.upper()} need the package typst"
        raise UsageError(problem, remedy="Install it with: pip install 'dynid[figures]'") from None
    inputs = {"svg": alone}
    if form == "pdf":
        return bytes(typst.compile(_PAGE, format="pdf", sys_inputs=inputs))
    return bytes(typst.compile(_PAGE, format="png", ppi=_PPI, sys_inputs=inputs))


def standalone(svg: str) -> str:
    """Return a figure as an SVG document with an XML declaration, on white, without CSS variables."""
    plain = resolved(svg).lstrip()
    head = _HEAD.match(plain)
    if head is None:
        raise ValueError("a figure starts with <svg …> and has a viewBox")
    x, y, width, height = head[1].split()
    paper = COLOURS["paper"][0]
    ground = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{paper}"/>'
    end = head.end()
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{plain[:end]}{ground}{plain[end:]}'
