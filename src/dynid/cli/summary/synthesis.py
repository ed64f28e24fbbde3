"""Screen of a synthesis: the wanted function, its forms, and the elements of each."""

from __future__ import annotations

from textwrap import wrap

from dynid.cli.summary.common import aligned
from dynid.report.content.synthesis import elements, form_table, forms, kind_text, wanted
from dynid.result import Result

#: Most elements of a form that are listed.
_MOST = 40


def lines(result: Result) -> list[str]:
    """Return the screen of a synthesis, line by line."""
    (name, formula), zeros, poles = wanted(result)
    shown = [f"  {name} = {formula}", f"  {kind_text(result)}", f"  zeros  {zeros}", f"  poles  {poles}", ""]
    columns, rows = form_table(result)
    shown += [*aligned([columns, *rows], "  "), ""]
    for form in forms(result):
        every = [f"{name} = {value}" for name, _, value in elements(result, form)]
        listed = ", ".join(every[:_MOST]) + (f", … ({len(every)} in all)" if len(every) > _MOST else "")
        shown += wrap(f"{form}: {listed}", 104, initial_indent="  ", subsequent_indent="    ")
    return shown
