"""A page of work–precision plots, each with its table: no script, no network, no other files."""

from __future__ import annotations

from html import escape
from io import StringIO
from string import Template

import numpy as np

from dynid.result import Result

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root { color-scheme: light dark; }
body { font: 1rem/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
svg { max-width: 100%; height: auto; background: white; }
table { border-collapse: collapse; } th, td { padding: .15rem .8rem; text-align: right; }
th:first-child, td:first-child { text-align: left; } tr.best { font-weight: 600; }
</style></head><body><h1>$title</h1>$sections</body></html>
""")
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKERS = "os^Dv<>"
#: Errors below this are drawn here: zero has no place on a logarithmic axis.
_LEAST = 1e-17


def page(result: Result) -> str:
    """Return the page of a benchmark result."""
    groups = list(dict.fromkeys("/".join(path.split("/")[:2]) for path in result))
    sections = "".join(_section(result, group) for group in groups)
    return _PAGE.substitute(title=escape(result.title), sections=sections)


def _section(result: Result, group: str) -> str:
    about = result.group_attrs[group]
    names = list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))
    said = {"failed": "failed", "missing": "missing", "chosen": "chosen by default"}
    notes = "".join(f"<p>{text}: {escape(str(about[w]))}</p>" for w, text in said.items() if about.get(w))
    heading = f"<h2>{escape(group.partition('/')[2])}</h2><p>{escape(str(about['title']))}</p>"
    return f"<section>{heading}{_plot(result, group, names)}{_table(result, group, names)}{notes}</section>"


def _table(result: Result, group: str, names: list[str]) -> str:
    about = result.group_attrs[group]
    head = f"<tr><th>alternative</th><th>{escape(str(about['size']))}</th><th>time, s</th>"
    rows = [f"{head}<th>memory, MB</th><th>{escape(str(about['measure']))}</th></tr>"]
    for name in names:
        columns = [result[f"{group}/{name}/{c}"].data for c in ("size", "time", "memory", "error", "pareto")]
        for size, time, memory, error, best in zip(*columns, strict=True):
            cells = (escape(name), f"{size:,}", f"{time:.3g}", f"{memory / 1e6:.3g}", f"{error:.1e}")
            mark = ' class="best"' if best else ""
            rows.append(f"<tr{mark}>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    return f"<table>{''.join(rows)}</table>"


def _plot(result: Result, group: str, names: list[str]) -> str:
    """Draw time against error, a line an alternative; what nothing beats is ringed."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context({"svg.hashsalt": "dynid", "svg.fonttype": "none"}):
        figure = Figure(figsize=(8, 4.5), layout="constrained")
        axes = figure.add_subplot()
        for place, name in enumerate(names):
            error, time, best = (
                result[f"{group}/{name}/{column}"].data for column in ("error", "time", "pareto")
            )
            shown = np.isfinite(error)
            error = np.maximum(error, _LEAST)
            style = {"color": _COLOURS[place % 7], "marker": _MARKERS[place % 7]}
            axes.loglog(error[shown], time[shown], label=name, linewidth=1, **style)
            front = shown & best
            axes.loglog(error[front], time[front], "o", ms=12, mfc="none", mec="0.4", mew=1)
        axes.set(xlabel=str(result.group_attrs[group]["measure"]), ylabel="time, s")
        axes.grid(visible=True, which="major", alpha=0.3)
        axes.legend(fontsize=8)
        stream = StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]
