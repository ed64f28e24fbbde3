"""Content of modes: those of a test beside those of the model, and what follows from an estimate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.number_format import counted, quantity
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable, on_page
from dynid.report.notation import texts
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Group of the modes in a result.
GROUP = "identification/modes"


def has_modes(result: Result) -> bool:
    """Return True if a result has measured modes."""
    return f"{GROUP}/frequency_measured" in result


def modal_summary(result: Result) -> str:
    """Return the numbers of modes and sensors, and the span of frequencies."""
    measured = result[f"{GROUP}/frequency_measured"]
    span = f"{measured.data.min():.5g} … {measured.data.max():.5g} {measured.units}"
    sensors = len(result[f"{GROUP}/sensor"].data) if f"{GROUP}/sensor" in result else 0
    at = f", shapes at {counted(sensors, 'sensor')}" if sensors else ""
    return f"{counted(measured.data.size, 'measured mode')}, {span}{at}"


def modal_table(result: Result) -> TextTable:
    """Return the table of the modes: frequency, its error and MAC before and after."""
    get = {
        path.removeprefix(f"{GROUP}/"): variable.data
        for path, variable in result.items()
        if path.startswith(GROUP)
    }
    unit = result[f"{GROUP}/frequency_measured"].units
    shapes, damping, left = "mac" in get, "damping_measured" in get, "left_out_error" in get
    heads = ["mode", f"measured {unit}", "model", "error at start", "error"]
    heads += ["left out"] * left + ["MAC at start", "MAC"] * shapes + ["ζ measured", "ζ"] * damping
    rows = []
    for k in range(len(get["mode"])):
        row = [str(k + 1), f"{get['frequency_measured'][k]:.5g}", f"{get['frequency'][k]:.5g}"]
        errors = ("frequency_error_start", "frequency_error", *(["left_out_error"] if left else []))
        row += [_text(100 * get[name][k], "{:+.2f} %") for name in errors]
        row += [_text(get[name][k], "{:.3f}") for name in ("mac_start", "mac") if shapes]
        row += [_text(100 * get[name][k], "{:.3g} %") for name in ("damping_measured", "damping") if damping]
        rows.append(tuple(row))
    return TextTable(tuple(heads), tuple(rows), noun="mode", most=ALL)


def _text(value: float, form: str) -> str:
    return "-" if np.isnan(value) else form.format(value)


def modal_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the comparison of measured and computed modes."""
    if has_modes(result):
        # Errors of the model's form, and what the data determine.
        statements = map(Statement, texts(result, f"{GROUP}/statements"))
        blocks = (on_page(Statement(modal_summary(result))), modal_table(result), *statements)
        yield ReportSection("Measured modes", blocks, "answer", screen="")


DERIVED, _POSTERIOR = "identification/derived", "identification/posterior"


def is_requested(result: Result) -> bool:
    """Return True if derived quantities were requested; those of small systems are in the file alone."""
    return bool(result.group_attrs.get(DERIVED, {}).get("requested", False))


def derived_table(result: Result) -> TextTable:
    """Return the table of the oscillating modes and zeros with their 95 % bands."""
    unit, rows = frequency_unit(result), list[tuple[str, ...]]()
    for path in result:
        if not path.startswith(DERIVED) or not path.endswith("/frequency/value"):
            continue
        group = path.removesuffix("/frequency/value")
        kind, _, channel = group.removeprefix(f"{DERIVED}/").partition("/")
        get = {
            (name, end): result[f"{group}/{name}/{end}"].data
            for name in ("frequency", "damping")
            for end in ("value", "low", "high")
        }
        for k in range(len(result[path].data)):
            cells = [f"{'zero' if kind == 'zeros' else 'mode'} {k + 1}{f' of {channel}' if channel else ''}"]
            for name, factor in (("frequency", unit.factor), ("damping", 100.0)):
                value, low, high = (factor * float(get[name, end][k]) for end in ("value", "low", "high"))
                error = (high - low) / 4
                ends = f"{quantity(low, error)} … {quantity(high, error)}" if error else "for all values"
                cells += [quantity(value, error or None), ends]
            rows.append(tuple(cells))
    return TextTable(("", unit.name, "95 % band", "ζ in %", "95 % band"), tuple(rows), most=20)


def statements(result: Result) -> Iterator[str]:
    """Yield the verdicts on the identified model, and that on its posterior."""
    group = f"{DERIVED}/verdicts"
    if f"{group}/verdict" in result and is_requested(result):
        names, texts = (result[f"{group}/{column}"].data for column in ("verdict", "statement"))
        for name, text in zip(names, texts, strict=True):
            channel = str(name).partition("minimum phase ")[2]
            yield f"{channel}: {text}" if channel else str(text)
    if f"{_POSTERIOR}/k_hat" in result:
        word = "is" if result.value(f"{_POSTERIOR}/gaussian") else "is not"
        yield (
            f"the posterior {word} Gaussian (k = {result.value(f'{_POSTERIOR}/k_hat'):.2f}, "
            f"{result.value(f'{_POSTERIOR}/effective_samples'):.0f} effective samples of "
            f"{result.group_attrs[_POSTERIOR]['samples']})"
        )


def derived_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the section on what follows from the estimate."""
    table = derived_table(result) if is_requested(result) else None
    tables = (table,) if table is not None and table.rows else ()
    if blocks := (*tables, *map(Statement, statements(result))):
        yield ReportSection("What follows from the estimate", blocks, "answer", screen="")
