"""Content on what follows from an estimate: modes and zeros with their bands, verdicts, the posterior."""

from __future__ import annotations

from collections.abc import Iterator

from dynid.number_format import quantity
from dynid.report.content.blocks import Block, ReportSection, Statement, TextTable, more
from dynid.report.scenes import frequency_unit
from dynid.result import Result

DERIVED, _POSTERIOR = "identification/derived", "identification/posterior"
#: Most rows of a table.
_ROWS = 20


def is_requested(result: Result) -> bool:
    """Return True if derived quantities were requested; those of small systems are in the file alone."""
    return bool(result.group_attrs.get(DERIVED, {}).get("requested", False))


def derived_table(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the oscillating modes and zeros with their 95 % bands."""
    unit, rows = frequency_unit(result), list[tuple[str, ...]]()
    for path in result:
        if not path.startswith(DERIVED) or not path.endswith("/frequency/value"):
            continue
        group = path.removesuffix("/frequency/value")
        kind, _, place = group.removeprefix(f"{DERIVED}/").partition("/")
        get = {
            (name, end): result[f"{group}/{name}/{end}"].data
            for name in ("frequency", "damping")
            for end in ("value", "low", "high")
        }
        for k in range(len(result[path].data)):
            cells = [f"{'zero' if kind == 'zeros' else 'mode'} {k + 1}{f' of {place}' if place else ''}"]
            for name, factor in (("frequency", unit.factor), ("damping", 100.0)):
                value, low, high = (factor * float(get[name, end][k]) for end in ("value", "low", "high"))
                error = (high - low) / 4
                ends = f"{quantity(low, error)} … {quantity(high, error)}" if error else "for all values"
                cells += [quantity(value, error or None), ends]
            rows.append(tuple(cells))
    return ("", unit.name, "95 % band", "ζ in %", "95 % band"), rows


def statements(result: Result) -> Iterator[str]:
    """Yield the verdicts on the identified model, and that on its posterior."""
    group = f"{DERIVED}/verdicts"
    if f"{group}/verdict" in result and is_requested(result):
        names, texts = (result[f"{group}/{part}"].data for part in ("verdict", "statement"))
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
    said = list(statements(result))
    if not (is_requested(result) or said):
        return
    columns, rows = derived_table(result) if is_requested(result) else ((), [])
    blocks: list[Block] = []
    if rows:
        blocks += [TextTable(columns, tuple(rows[:_ROWS])), *more(len(rows), _ROWS, "row")]
    blocks += [Statement(f"{text[0].upper()}{text[1:]}.") for text in said]
    yield ReportSection("What follows from the estimate", tuple(blocks), "answer")
