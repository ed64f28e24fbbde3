"""Sensitivities of the zeros, poles and gains of a channel to its parameters.

The logarithmic derivative d log T / dp of a transfer function has a simple pole at every zero and pole of T;
its residue there is the rate at which the root moves with p (of a zero with the sign turned). The residue is
an integral over a small circle around the root, on which the reduction program is run together with its
derivatives (`program.gradient`); the trapezoidal rule converges geometrically there (Trefethen & Weideman,
SIAM Review 56, 2014). No polynomial is formed. The next moment of the integral must vanish; where it does
not, roots meet there and part with a root of the parameter: the rate is infinite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dynid.arrays import guarded
from dynid.bondgraph.analysis_request import Analysis, SensitivityParameter, modelled_storages
from dynid.bondgraph.exact_engine import exact_channels
from dynid.bondgraph.program.bounded import Bounded
from dynid.bondgraph.program.program import Register, gradient
from dynid.bondgraph.reduced_graph import ReducedGraph, characteristic_polynomials
from dynid.errors import NumericalError, UsageError
from dynid.lti.certified_roots import CertifiedRoot, certified_roots, repeated
from dynid.result import Result

if TYPE_CHECKING:
    from numpy.typing import NDArray


#: Points on a circle, and its radius over the distance to the next singularity: the trapezoidal rule is off
#: by about their power, 3e-31, and less than by rounding where singularities are multiple.
_CIRCLE_POINTS, _RADIUS_FACTOR = 64, 1 / 3
#: Largest rounding error of a moment, over the largest value on the circle, in doubles and in balls.
_MOMENT_RTOL = 1e-10
#: What is less than this part of a root's distance to the next one, or of a gain, counts as little.
_NOTICED_RTOL, _TINY_RESPONSE = 1e-4, 1e-280
#: The points of the unit circle.
_TURN = np.exp(2j * np.pi * (np.arange(_CIRCLE_POINTS) + 0.5) / _CIRCLE_POINTS)
#: A moment below this, over the largest value on the circle, is zero.
_ZERO_MOMENT_RTOL = 1e-6
#: Bits of the ball arithmetic that takes over where doubles are not enough.
_SENSITIVITY_PRECISIONS = (128, 512, 2048)


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives with respect to parameters, one column a parameter; inf where there is none."""

    #: zeros, poles: Rates of the roots, each as often as its multiplicity says (of a multiple root: of the
    #: mean).
    zeros: NDArray[np.complex128]
    poles: NDArray[np.complex128]
    #: dc_gain, high_frequency_gain: Rates of T(0) and T(inf).
    dc_gain: NDArray[np.float64]
    high_frequency_gain: NDArray[np.float64]


@dataclass(frozen=True)
class _Circle:
    """A circle to integrate over: around a root of T, around 0 (T(0)), or around all roots (T(inf))."""

    centre: complex
    radius: float
    about: Literal["root", "zero", "infinity"]

    @property
    def points(self) -> NDArray[np.complex128]:
        """Points on it."""
        return np.asarray(self.centre + self.radius * _TURN, dtype=np.complex128)

    def integral(self, integrand: Bounded, scale: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the residue (of a root) or the mean (of a gain) of each row of values on the circle.

        It is inf where the integrand, on the given scale, has more than a simple pole (of a root), or a pole
        (of a gain); what does not rise above rounding is 0.
        """
        power, *vanishing = {"root": (1, 2), "zero": (0, 1, 2), "infinity": (0, -1, -2)}[self.about]
        moments = [np.abs((integrand.value * _TURN**k).mean(axis=1)) for k in vanishing]
        rates = np.asarray((integrand.value * _TURN**power).mean(axis=1), dtype=np.complex128)
        noise = np.mean(integrand.error, axis=1) + 4 * np.finfo(float).eps * scale
        rates.real[np.abs(rates.real) <= noise] = 0
        rates.imag[np.abs(rates.imag) <= noise] = 0
        singular = np.max(moments, axis=0) > _ZERO_MOMENT_RTOL * scale
        rates *= self.radius if self.about == "root" else 1.0
        rates[singular] = np.inf
        return rates


def sensitivity(
    reduced: ReducedGraph,
    register: Register,
    zeros: Sequence[CertifiedRoot],
    poles: Sequence[CertifiedRoot],
    hidden: Iterable[complex],
    parameters: Sequence[SensitivityParameter],
) -> Sensitivity:
    """Return the derivatives of one channel's zeros, poles and gains by parameters.

    `hidden`: natural modes that it does not show: its derivatives may be singular there. `parameters`: what
    to differentiate by. Raises `NumericalError` where roots lie too close together for the precision at hand.
    """
    others = np.array([*(root.value for root in (*zeros, *poles)), *hidden, 0], dtype=complex)
    around = {}
    for root in (*zeros, *poles):
        if root.value.imag >= 0:
            distances = np.abs(others - root.value)
            gap = float(distances[distances > 0].min()) if (distances > 0).any() else 1.0
            around[root.value] = _Circle(root.value, _RADIUS_FACTOR * gap, "root")
    sizes = [abs(parameter.value) or Fraction(1) for parameter in parameters]
    scaled = [
        SensitivityParameter(p.name, p.value, {name: rate * size for name, rate in p.rates.items()})
        for p, size in zip(parameters, sizes, strict=True)
    ]
    units = np.array([float(size) for size in sizes])
    # T(0) from a circle with no root but 0 in it, T(inf) from one around all roots
    moduli = np.abs(others[others != 0])
    at_zero = _Circle(0j, _RADIUS_FACTOR * moduli.min() if len(moduli) else 1.0, "zero")
    at_infinity = _Circle(0j, moduli.max(initial=0.0) / _RADIUS_FACTOR or 1.0, "infinity")
    circles = [at_zero, at_infinity, *around.values()]
    points = np.concatenate([circle.points for circle in circles])
    transfer, slopes = _in_doubles(reduced, register, scaled, points)
    rates = np.empty((len(circles), len(scaled)), dtype=complex)
    for row, circle in enumerate(circles):
        columns = slice(row * _CIRCLE_POINTS, (row + 1) * _CIRCLE_POINTS)
        again = partial(_in_balls, reduced, register, scaled, circle.points)
        rates[row] = _first_settled(circle, (transfer[columns], slopes[:, columns]), again)
    dc, high, *root_rates = rates
    of = partial(_of_roots, dict(zip(around, root_rates, strict=True)), units)
    return Sensitivity(of(zeros, -1), of(poles, 1), dc.real / units, high.real / units)


@guarded("a sensitivity")
def _of_roots(
    residues: Mapping[complex, NDArray[np.complex128]],
    units: NDArray[np.float64],
    roots: Sequence[CertifiedRoot],
    sign: int,
) -> NDArray[np.complex128]:
    """Return the rates of roots by their residues; the lower of a pair has the conjugate."""
    rows = []
    for root in roots:
        upper = residues[complex(root.value.real, abs(root.value.imag))]
        finite = np.isfinite(upper)
        rate = np.where(finite, upper, 0) * sign / root.multiplicity / units
        rate = np.where(finite, rate if root.value.imag >= 0 else rate.conj(), np.inf)
        rows += [rate + 0] * root.multiplicity  # + 0: no -0
    return np.array(rows, dtype=complex).reshape(len(rows), len(units))


def _first_settled(
    circle: _Circle, run: tuple[Bounded, Bounded], again: Callable[[int], tuple[Bounded, Bounded]]
) -> NDArray[np.complex128]:
    """Return the integrals over a circle at the first precision that is high enough."""
    for bits in (*_SENSITIVITY_PRECISIONS, 0):
        transfer, slopes = run
        with np.errstate(all="ignore"):  # what overflows has no finite bound
            integrand = slopes / transfer if circle.about == "root" else slopes
            scale_of_whole = (
                1 / circle.radius if circle.about == "root" else np.abs(transfer.value).max() + _TINY_RESPONSE
            )
            scale = np.maximum(np.abs(integrand.value).max(axis=1), _NOTICED_RTOL * scale_of_whole)
            if np.all(np.max(integrand.error, axis=1) <= _MOMENT_RTOL * scale):
                return circle.integral(integrand, scale)
        if bits:
            run = again(bits)
    raise NumericalError(
        f"the sensitivities near s = {circle.centre:.6g} are lost to round-off with "
        f"{_SENSITIVITY_PRECISIONS[-1]} bits",
        remedy="Roots lie too close together there; leave 'sensitivities' out of the results.",
    )


def _slopes(
    reduced: ReducedGraph,
    register: Register,
    parameters: Sequence[SensitivityParameter],
    number: Callable[[Fraction], Any],
    laplace: Any,
) -> tuple[Any, list[Any]]:
    """Return T and dT/dp for every parameter, over any number type (the chain rule through the nodes)."""
    values = {name: number(reduced.graph.value(name)) for name in reduced.valued}
    transfer, partials = gradient(reduced.program, register, values, laplace, number(Fraction(1)))
    slopes = []
    for parameter in parameters:
        terms = (partials[name] * number(rate) for name, rate in parameter.rates.items() if name in partials)
        slopes.append(sum(terms, start=number(Fraction(0))))
    return transfer, slopes


def _in_doubles(
    reduced: ReducedGraph,
    register: Register,
    parameters: Sequence[SensitivityParameter],
    points: NDArray[np.complex128],
) -> tuple[Bounded, Bounded]:
    """Return T (points) and dT/dp (parameters x points), with error bounds."""

    def number(value: Fraction) -> Bounded:
        return Bounded.rounded(float(value))

    exact = Bounded(points, np.zeros(len(points)))
    with np.errstate(all="ignore"):
        transfer, slopes = _slopes(reduced, register, parameters, number, exact)
    zero = Bounded(np.zeros(len(points), complex), np.zeros(len(points)))
    rows = [transfer + zero, *(slope + zero for slope in slopes)]
    shape = len(parameters), len(points)
    value, error = (
        np.array([getattr(r, quantity) for r in rows[1:]]).reshape(shape) for quantity in ("value", "error")
    )
    return rows[0], Bounded(value, error)


def _in_balls(
    reduced: ReducedGraph,
    register: Register,
    parameters: Sequence[SensitivityParameter],
    points: NDArray[np.complex128],
    bits: int,
) -> tuple[Bounded, Bounded]:
    """Return T and dT/dp as `_in_doubles`, rounded from ball arithmetic of so many bits."""
    from flint import acb, arb, ctx, fmpq

    def number(value: Fraction) -> Any:
        return acb(arb(fmpq(value.numerator, value.denominator)))

    with ctx.workprec(bits):
        columns = []
        for point in points:
            transfer, slopes = _slopes(reduced, register, parameters, number, acb(point.real, point.imag))
            columns.append([transfer, *slopes])
        mid = np.array([[complex(float(b.real.mid()), float(b.imag.mid())) for b in c] for c in columns]).T
        rad = np.array([[float(b.rad()) for b in c] for c in columns]).T
    return Bounded(mid[0], rad[0]), Bounded(mid[1:], rad[1:])


# --- result ----------------------------------------------------------------------------------------

#: Most storage elements with which they are taken unasked: the work grows with the cube.
_MAX_SENSITIVITY_STORAGES = 100

_NOTE = (
    "inf: roots meet there, and part with a root of the parameter; of a multiple root it is the mean "
    "that moves as said"
)


def add_sensitivities(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Add the derivatives of every channel's zeros, poles and gains by the parameters.

    Beside each derivative stands the one by the parameter's logarithm (`…_relative`): what moves per
    relative change, so that parameters of different units can be compared.

    Raises `UsageError` where the graph is so large that they would take very long, and nobody insists on it.
    """
    size = modelled_storages(reduced)
    if size > _MAX_SENSITIVITY_STORAGES and analysis.engine != "exact":
        raise UsageError(
            f"sensitivities of a graph of {size:,} storage elements take very long: they are computed up to "
            f"{_MAX_SENSITIVITY_STORAGES}",
            remedy="Drop 'sensitivities' from the results, or insist with 'engine: exact'.",
            names=("analysis.results",),
        )
    registers = reduced.channels()
    modes = {port: repeated(certified_roots(p)) for port, p in characteristic_polynomials(reduced).items()}
    modelled = {name for reduction in reduced.reductions.values() for name in reduction.modelled}
    if analysis.parameters is None:
        parameters = [
            SensitivityParameter(name, reduced.graph.value(name), {name: Fraction(1)})
            for name in reduced.valued
            if name in modelled
        ]
    else:
        parameters = [parameter for parameter in analysis.parameters if modelled & parameter.rates.keys()]
    for (port, source), transfer in exact_channels(reduced).items():
        roots = transfer.zeros, transfer.poles
        rates_of = sensitivity(reduced, registers[port, source], *roots, modes[port], parameters)
        group = f"bond_graph/sensitivities/{port}/{source}"
        result.annotate(group, note=_NOTE)
        result.add_axis(f"{group}/parameter", np.array([p.name for p in parameters], dtype=object))
        sizes = np.array([float(p.value) for p in parameters])
        result.add(f"{group}/value", sizes, ("parameter",))
        for name, roots_of, rates in zip(
            ("zero", "pole"), roots, (rates_of.zeros, rates_of.poles), strict=True
        ):
            result.add_numbered(f"{group}/{name}", repeated(roots_of), "rad/s")
            _add_rates(result, f"{group}/{name}_sensitivity", rates, sizes, (name, "parameter"), "rad/s")
        for gain, slopes in (
            ("dc_gain", rates_of.dc_gain),
            ("high_frequency_gain", rates_of.high_frequency_gain),
        ):
            _add_rates(result, f"{group}/{gain}_sensitivity", slopes, sizes, ("parameter",))


def _add_rates(
    result: Result, path: str, rates: Any, sizes: Any, dims: tuple[str, ...], units: str = ""
) -> None:
    per_unit = f"{units or '1'}/(unit of the parameter)"
    result.add(path, rates, dims, per_unit)
    finite = np.isfinite(rates)
    relative = np.where(finite, np.where(finite, rates, 0) * sizes, np.inf)
    result.add(f"{path}_relative", relative, dims, units)
