"""Content of syntheses: the wanted function, its forms, and the elements of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from dynid.number_format import quantity, roots_text, unit_text
from dynid.report.content.blocks import (
    ALL,
    ReportSection,
    Statement,
    TextTable,
    definitions,
    joined,
    on_page,
    on_screen,
)
from dynid.report.content.transfer_functions import numeric_forms
from dynid.report.drawing.sketch import ELEMENT_UNITS
from dynid.report.notation import texts
from dynid.report.scenes import in_hertz
from dynid.result import Result

#: Types of elements, in the order of the tables.
TYPES = ("I", "C", "R", "TF")
#: Most elements of a form on a screen.
_ELEMENTS = 40
#: Kinds of functions in words.
_KINDS = {
    "R": "a resistance",
    "LC": "lossless: I and C alone",
    "RC": "of R and C alone",
    "RL": "of R and I alone",
    "RLC": "of R, I and C",
}


def method(result: Result) -> str:
    """Return the kind of analysis and the forms."""
    return f"synthesis · {', '.join(texts(result, 'synthesis/form'))}"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the requested function, the table of the forms, and the elements of each."""
    function, zeros, poles = _wanted(result)
    kind = f"positive real, of degree {_about(result, 'degree')}, {_KINDS[_about(result, 'kind')]}"
    items = definitions(function, ("kind", kind), ("zeros", zeros), ("poles", poles))
    yield ReportSection(f"Driving-point {_about(result, 'function')}", (items,), "answer", screen="")
    rows = []
    residuals = result["synthesis/residual"].data
    for form, residual in zip(texts(result, "synthesis/form"), residuals, strict=True):
        counts = Counter(map(str, result[f"synthesis/{form}/type"].data))
        numbers = (str(counts[kind]) if counts[kind] else "" for kind in TYPES)
        rows.append((form, *numbers, f"{residual:.1e}" if residual else "exact"))
    table = TextTable(("", *TYPES, "error of its coefficients"), tuple(rows))
    yield ReportSection("Forms", (table,), "answer", screen="")
    for form in texts(result, "synthesis/form"):
        rows_of_form = tuple(_elements(result, form))
        values = on_page(TextTable(("", "type", "value"), rows_of_form, most=ALL))
        listed = joined((f"{name} = {value}" for name, _, value in rows_of_form), _ELEMENTS)
        place = "answer" if len(table.rows) == 1 else "details"
        blocks = (values, on_screen(Statement(listed, head=f"{form}:")))
        yield ReportSection(f"Elements, {form} form", blocks, place, screen="")


def _wanted(result: Result) -> tuple[tuple[str, str], str, str]:
    """Return the function as name and formula, its zeros, and its poles."""
    name = "Y(s)" if _about(result, "function") == "admittance" else "Z(s)"
    hertz, unit = in_hertz(result), unit_text(_about(result, "unit"))
    formula = next(iter(numeric_forms(result, "synthesis")), "as given")
    zeros, poles = (roots_text(result[f"synthesis/{kind}"].data, hertz=hertz) for kind in ("zeros", "poles"))
    return (name, f"{formula} {unit}".rstrip()), zeros, poles


def _elements(result: Result, form: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and value of every element of a form."""
    units = ELEMENT_UNITS.get(_about(result, "domain"), {})
    parts = (result[f"synthesis/{form}/{column}"].data for column in ("element", "type", "value"))
    for name, kind, value in zip(*parts, strict=True):
        yield str(name), str(kind), f"{quantity(float(value))} {units.get(str(kind), '')}".rstrip()


def _about(result: Result, key: str) -> str:
    return str(result.group_attrs["synthesis"][key])
