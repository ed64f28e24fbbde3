"""Content of modal analyses: modes with their standard errors, the fit, and the scale of the shapes."""

from __future__ import annotations

from collections.abc import Iterator

from dynid.number_format import counted, quantity
from dynid.report.content.blocks import ALL, ReportSection, Statement, TextTable
from dynid.report.notation import texts
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Group of the modes.
GROUP = "modal"


def method(result: Result) -> str:
    """Return the kind of analysis, and the numbers of modes and responses."""
    shape = result[f"{GROUP}/shape"].data.shape
    return f"modal analysis · {counted(shape[0], 'mode')} at {counted(shape[1], 'DOF')}"


def modes_table(result: Result) -> TextTable:
    """Return the table of the modes with standard errors."""
    unit = frequency_unit(result)
    get = {name: result[f"{GROUP}/{name}"].data for name in _COLUMNS}
    rows = []
    for k, (omega, error, zeta, zeta_error, complexity) in enumerate(zip(*get.values(), strict=True), 1):
        frequency, deviation = unit.factor * float(omega), unit.factor * float(error)
        rows.append(
            (
                str(k),
                quantity(frequency, deviation),
                f"{deviation:.2g}",
                quantity(100 * float(zeta), 100 * float(zeta_error)),
                f"{100 * float(zeta_error):.2g}",
                f"{complexity:.3f}",
            )
        )
    heads = ("mode", unit.name, "standard error", "ζ in %", "standard error", "complexity")
    return TextTable(heads, tuple(rows), noun="mode", brief=ALL)


# Level of the test of real shapes, and the least p-value that is printed.
_LEVEL, _MIN_P = 1e-3, 1e-12
_COLUMNS = ("frequency", "frequency_standard_error", "damping", "damping_standard_error", "complexity")


def statements(result: Result) -> Iterator[Statement]:
    """Yield what the modes rest on: the fit, reciprocity, the scale of the shapes."""
    scale = result[f"{GROUP}/shape"].attrs["normalisation"]
    if f"{GROUP}/periods" in result:
        periods = result.value(f"{GROUP}/periods")
        yield Statement(
            f"responses to ambient excitation over {periods:.0f} periods of the lowest mode; shapes of "
            f"{scale}, without a scale of masses"
        )
        return
    ratio = result.value(f"{GROUP}/fit/chi2") / result.value(f"{GROUP}/fit/degrees")
    lacks = bool(result.value(f"{GROUP}/fit/lacks_fit"))
    noise = result.group_attrs[GROUP]["noise"]
    by = "whose noise is estimated from them" if noise == "estimated" else "with their stated noise"
    verdict = "leaves more than noise" if lacks else "leaves noise"
    text = f"the fit {verdict} of the responses, {by}: chi-squared {ratio:.3f} of its expectation"
    if noise == "estimated":
        text += f", scatter from line to line {result.value(f'{GROUP}/fit/whiteness'):.3f} of white noise"
    yield Statement(text, "bad" if lacks else "good")
    if f"{GROUP}/fit/reciprocity" in result:
        p = result.value(f"{GROUP}/fit/reciprocity")
        used = "used" if result.group_attrs[GROUP].get("reciprocal") else "not used"
        yield Statement(f"reciprocity of the references: {_p(p)}, {used}")
    if f"{GROUP}/fit/real_shapes" in result:
        p = result.value(f"{GROUP}/fit/real_shapes")
        reading = "complex shapes are needed" if p < _LEVEL else "not contradicted; modes: {shapes: real}"
        yield Statement(f"real shapes: {_p(p)}, {reading}")
    yield Statement(f"shapes of {scale}; references {', '.join(texts(result, f'{GROUP}/reference'))}")


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value > _MIN_P else f"p < {_MIN_P:g}"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the modes, and what they rest on."""
    blocks = (modes_table(result), *statements(result))
    yield ReportSection("Modes", blocks, "answer", screen="")
    if f"{GROUP}/warnings" in result:
        doubts = tuple(Statement(text, "bad") for text in texts(result, f"{GROUP}/warnings"))
        yield ReportSection("Warnings", doubts, "answer")
