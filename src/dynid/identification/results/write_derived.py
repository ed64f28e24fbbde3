"""Quantities that follow from an estimate, and noise that is not white, as named arrays.

Below ``identification/derived/``:

- `poles`: `value`, `low`, `high` (95 %; complex, the bands of real and imaginary parts), 1/s, those with
  negative imaginary parts left out; `method` of each part. Roots that round-off does not resolve are given
  as one, as often as they are: `multiplicity`.
- `modes/frequency`, `modes/damping`: natural frequencies (rad/s) and damping ratios of the pairs of poles.
- `zeros/<output>/<input>`: the finite zeros of the pair, as the poles; `frequency` and `damping` of the pairs
  among them.
- `gains/<output>/<input>/<dc | high_frequency>`, where they are finite.
- `frequency_response/<output>/<input>`: `magnitude` and `phase` (rad) by `omega`.
- `verdicts`: statements such as `stable` with their probability; `always` marks those that hold, or fail, for
  all values of the parameters.

The methods are ``delta``, ``delta of the logarithm`` and ``samples``; see `derived`.

Of noise that is not white: ``identification/noise/``.

- Attribute `kind`: coloured or proportional.
- Coloured: the autoregression ``x_t = a_1 x_(t-1) + … + e_t`` of each channel: `order`,
  `coefficients` (channel x lag, 0 beyond the order), `innovation` and `deviation`, the standard deviations of
  e and x; `bic` of each `tried` order less that of white noise (channel x tried, NaN where not tried); and
  `correlation` of e between channels (channel x other) where that is estimated.
- Proportional: the `ratio` of the deviation of the complex noise to the response (channel).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.derived import (
    FEW_SAMPLES,
    SAMPLES,
    ConfidenceBand,
    DerivedQuantities,
    GaussianPosterior,
    Pair,
    RootFamily,
    Verdict,
    pairs_of,
)
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.noise import Autoregression
from dynid.identification.systems.linear_system import LinearSystem
from dynid.result import Result, common_unit

#: Group of the derived quantities.
DERIVED = "identification/derived"
#: Their names in scenes.
KINDS = ("poles", "zeros", "modes", "frequency_response")

# Without a request they are computed of systems of up to so many states, parameters and pairs.
_MAX_STATES, _MAX_PARAMETERS, _MAX_PAIRS = 40, 12, 8
# Lines of a response whose frequencies are not given, and how far they reach beyond the modes.
_GRID_LINES, _BEYOND_MODES = 100, 3.0


@dataclass(frozen=True, eq=False)
class DerivedRequest:
    """Derived quantities to compute: their kinds, and the frequencies (rad/s) of responses.

    Without frequencies a grid around the modes is taken.
    """

    kinds: Sequence[str] = KINDS
    omega: Array | None = None


def add_derived(result: Result, posterior: Posterior, request: DerivedRequest | None = None) -> None:
    """Add the derived quantities of an identification; without a request those of small systems alone.

    Raises DynidError if one was requested and cannot be computed.
    """
    systems = [(system, pairs) for system, pairs in _systems(posterior) if len(system.states)]
    if request is None:
        sizes = [(len(system.states), len(system.unknowns), len(pairs)) for system, pairs in systems]
        small = all(np.all(np.array(size) <= (_MAX_STATES, _MAX_PARAMETERS, _MAX_PAIRS)) for size in sizes)
        if not small or not posterior.converged:
            return
        unrequested = Result("identification")
        try:
            _add_all(unrequested, gaussian(posterior, FEW_SAMPLES), DerivedRequest(), systems)
            unrequested.annotate(DERIVED, requested=False)
        except (DynidError, np.linalg.LinAlgError):
            return
        result.merge(unrequested)
    elif request.kinds:
        _add_all(result, gaussian(posterior), request, systems)
        result.annotate(DERIVED, requested=True)


def gaussian(posterior: Posterior, samples: int = SAMPLES) -> GaussianPosterior:
    """Return the posterior of the coordinates: Gaussian, or samples of that which limits cut off."""
    likelihood, priors, drawn = posterior.likelihood, posterior.likelihood.priors, posterior.limited.samples
    if drawn is not None:
        drawn = drawn[np.linspace(0, len(drawn) - 1, samples).round().astype(int)]
    return GaussianPosterior(
        likelihood.unknowns, posterior.fit.eta, posterior.root, priors.low, priors.high, samples, drawn
    )


def _systems(posterior: Posterior) -> list[tuple[LinearSystem, list[Pair]]]:
    """Return the system of each record with the pairs of its channels and loads that no other has."""
    systems: list[tuple[LinearSystem, list[Pair]]] = []
    seen: set[tuple[str, str]] = set()
    for record in posterior.likelihood.records:
        if isinstance(record, FrfRecord):
            system = record.system.system.unfiltered
            functions = zip(record.channels, record.system.pairs, strict=True)
            pairs = [
                Pair(function.channel.name, str(function.force), function.unit, *pair_indices)
                for function, pair_indices in functions
            ]
        elif isinstance(record, TimeRecord):
            system = record.model.system.unfiltered
            loads = record.conditions.loads
            pairs = pairs_of(
                [(channel.name, channel.unit) for channel in record.channels],
                [(load.name, load.unit) for load in loads],
            )
        else:
            continue
        alone = {(pair.output, pair.input): pair for pair in pairs}  # of several amplitudes one
        systems.append((system, [pair for names, pair in alone.items() if names not in seen]))
        seen |= alone.keys()
    return systems


def _add_all(
    result: Result,
    posterior: GaussianPosterior,
    request: DerivedRequest,
    systems: Sequence[tuple[LinearSystem, list[Pair]]],
) -> None:
    result.annotate(DERIVED, confidence=0.95, samples=posterior.count)
    verdicts: list[Verdict] = []
    for number, (system, pairs) in enumerate(systems):
        derived = DerivedQuantities(posterior, system)
        if number == 0:
            verdicts.append(derived.poles.verdict("stable", "pole", "stable"))
            if "poles" in request.kinds:
                _add_roots(result, f"{DERIVED}/poles", "pole", derived.poles)
            if "modes" in request.kinds:
                _add_pairs(result, f"{DERIVED}/modes", "mode", derived.poles)
        if "zeros" in request.kinds:
            for pair in pairs:
                verdicts += _add_zeros(result, derived, pair)
        if "frequency_response" in request.kinds:
            omega = request.omega
            if omega is None:  # around the poles
                size = np.abs(derived.poles.reference.values)
                size = size[size > 0] if size.any() else np.ones(1)
                omega = np.geomspace(size.min() / _BEYOND_MODES, size.max() * _BEYOND_MODES, _GRID_LINES)
            for pair in pairs:
                group = f"{DERIVED}/frequency_response/{pair.output}/{pair.input}"
                magnitude, phase = derived.response(omega, pair)
                for name, band, unit in (("magnitude", magnitude, pair.unit), ("phase", phase, "rad")):
                    result.add_axis(f"{group}/{name}/omega", omega, "rad/s")
                    _add_band(result, f"{group}/{name}", band, ("omega",), unit)
    group = f"{DERIVED}/verdicts"
    result.add_axis(f"{group}/verdict", [verdict.name for verdict in verdicts])
    for name in ("holds", "probability", "always", "statement"):
        result.add(f"{group}/{name}", [getattr(verdict, name) for verdict in verdicts], ("verdict",))


def _add_zeros(result: Result, derived: DerivedQuantities, pair: Pair) -> list[Verdict]:
    group = f"{DERIVED}/zeros/{pair.output}/{pair.input}"
    family = derived.zeros(pair)
    name = f"minimum phase {pair.output}/{pair.input}"
    if family is None:
        return [Verdict(name, False, 0.0, True, "the input does not affect the output")]
    _add_roots(result, group, "zero", family)
    _add_pairs(result, group, "pair", family)
    for gain, band in derived.gains(pair, family).items():
        _add_band(result, f"{DERIVED}/gains/{pair.output}/{pair.input}/{gain}", band.part(0), (), pair.unit)
    return [family.verdict(name, "zero", "minimum phase")]


def _add_roots(result: Result, group: str, axis: str, family: RootFamily) -> None:
    real, imaginary = family.parts()
    result.add_axis(f"{group}/{axis}", np.arange(1, len(real.value) + 1))
    for name in ("value", "low", "high"):
        both = np.empty(len(real.value), dtype=np.complex128)
        both.real, both.imag = getattr(real, name), getattr(imaginary, name)  # a sum is NaN of infinite ends
        result.add(f"{group}/{name}", both, (axis,), "1/s")
    result.add_all(group, (axis,), method_real=real.method, method_imaginary=imaginary.method)
    on_axis, multiplicity = family.on_axis[family.shown], family.multiplicity[family.shown]
    result.add_all(group, (axis,), on_axis=on_axis, multiplicity=multiplicity)


def _add_pairs(result: Result, group: str, axis: str, family: RootFamily) -> None:
    """Add natural frequencies and damping ratios of the pairs; nothing where there are none."""
    if not len(family.oscillating):
        return
    for name, band, unit in zip(("frequency", "damping"), family.frequencies(), ("rad/s", ""), strict=True):
        result.add_axis(f"{group}/{name}/{axis}", np.arange(1, len(band.value) + 1))
        _add_band(result, f"{group}/{name}", band, (axis,), unit)


def _add_band(result: Result, group: str, band: ConfidenceBand, dims: tuple[str, ...], unit: str) -> None:
    result.add_all(group, dims, unit, value=band.value, low=band.low, high=band.high)
    result.add(f"{group}/method", band.method, dims)


GROUP = "identification/noise"


def add_noise(result: Result, posterior: Posterior) -> None:
    """Add ``noise/``: the model of a noise that is not white."""
    records = posterior.likelihood.records
    waves = [isinstance(record, TimeRecord | FrfRecord) for record in records]
    places = [channel for channel in posterior.channels if waves[channel.record]]
    names = [channel.name for channel in places]
    result.add_axis(f"{GROUP}/channel", names)
    if isinstance(records[0], FrfRecord):
        result.annotate(GROUP, kind="proportional")
        result.add(f"{GROUP}/ratio", np.sqrt(2) * posterior.noise[0], ("channel",))
        return
    result.annotate(GROUP, kind="coloured")
    # A record whose noise is given, beside others of coloured noise, is white.
    colours = [
        (Autoregression.of((), len(level)) if record.colour is None else record.colour, level)
        for record, level in zip(records, posterior.noise, strict=True)
        if isinstance(record, TimeRecord)
    ]
    dims, unit = ("channel",), common_unit(channel.unit for channel in places)
    innovation = np.concatenate([colour.innovations(level) for colour, level in colours])
    orders, shares = (np.concatenate([getattr(c, name) for c, _ in colours]) for name in ("orders", "shares"))
    result.add(f"{GROUP}/order", orders, dims)
    result.add_axis(f"{GROUP}/lag", np.arange(1, int(orders.max()) + 1))
    result.add(f"{GROUP}/coefficients", _rows([c.coefficients for c, _ in colours], 0.0), ("channel", "lag"))
    result.add_all(GROUP, dims, unit, innovation=innovation, deviation=innovation / shares)
    bic = _rows([np.zeros((len(c.orders), 1)) if c.bic is None else c.bic.T for c, _ in colours], np.nan)
    result.add_axis(f"{GROUP}/tried", np.arange(bic.shape[1]))
    result.add(f"{GROUP}/bic", bic, ("channel", "tried"))
    if any(colour.mixing is not None for colour, _ in colours):
        correlation, first = np.eye(len(names)), 0
        for colour, level in colours:
            here = slice(first, first + len(level))
            correlation[here, here], first = colour.correlation, here.stop
        result.add_axis(f"{GROUP}/other", names)
        result.add(f"{GROUP}/correlation", correlation, ("channel", "other"))


def _rows(matrices: list[Array], filling: float) -> Array:
    """Return the rows of matrices below each other, filled up to one width."""
    width = max(matrix.shape[1] for matrix in matrices)
    stacked = np.full((sum(map(len, matrices)), width), filling)
    first = 0
    for matrix in matrices:
        stacked[first : first + len(matrix), : matrix.shape[1]] = matrix
        first += len(matrix)
    return stacked
