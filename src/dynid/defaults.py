"""Default choices where a scene leaves one open, each with the benchmark that justifies it.

The code takes its thresholds from here; results, `dynid bench` and the documentation quote the same
sentences. To change one: run its benchmark, read the table, and change the number. Limits of cost have no
benchmark: up to them the more accurate way is affordable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Default(Generic[T]):
    """A default choice; in its sentence ``{value}`` stands for the value."""

    value: T  # the threshold, or the chosen option
    benchmark: str  # whose table justifies it (`dynid bench NAME`)
    sentence: str

    def __str__(self) -> str:
        return f"{self.sentence.format(value=self.value)} (see `dynid bench {self.benchmark}`)"


@dataclass(frozen=True)
class _Threshold(Generic[T]):
    """A threshold that no benchmark justifies; in its sentence ``{value}`` stands for the value."""

    value: T
    sentence: str

    def __str__(self) -> str:
        return self.sentence.format(value=self.value)


class Limit(_Threshold[T]):
    """A limit of cost: up to it the more accurate way is taken, beyond it another, or an error is raised."""


class Level(_Threshold[T]):
    """A level of a statistical decision."""


# Bond graphs: engines.
EXACT_ROOTS = Default(
    400, "zeros-poles", "exact zeros and poles up to {value:,} storage elements, floating-point above"
)  # fmt: skip
EXACT_POLYNOMIALS = Default(
    1000, "polynomials", "exact polynomials up to {value:,} storage elements where no roots are requested"
)
MANY_LOOPS = Default(4, "loops", "junction structures with more than {value} loops have limits of their own")
EXACT_ROOTS_ON_LOOPS = Default(
    80, "loops", "exact zeros and poles up to {value} storage elements on many loops"
)
EXACT_POLYNOMIALS_ON_LOOPS = Default(
    150, "loops", "exact polynomials up to {value} storage elements on many loops"
)
STARTED_ROOTS = Default(
    40, "zeros-poles", "roots of polynomials beyond degree {value} are certified from eigenvalues"
)
COMPILED_RESPONSES = Default(
    2000,
    "frequency-response",
    "frequency responses of more than {value:,} operations run compiled, in doubled precision",
)
PLANNED_ANEW = Default(
    100_000,
    "frequency-response-on-loops",
    "graphs are planned anew where more than {value:,} operations would be left to ball arithmetic",
)
NODAL_RESPONSES = Default(
    60,
    "mesh-response",
    "frequency responses whose elimination takes more than {value} products an equation are solved for by "
    "sparse factors",
)
LARGE_GRAPHS = Default(
    100, "frequency-response-of-trees", "graphs of {value} bonds and more are planned by the C library"
)
SPARSE_REFINEMENT = Default(
    150, "pencils", "eigenvalues of sparse pencils are refined by sparse factors from {value} equations on"
)
SHARED_POLYNOMIALS = Limit(
    4000, "samples share polynomials of up to {value:,} terms; with more each is run on the shared plan"
)
PEAKS_NEAR_POLES = Limit(
    200,
    "resonances between the frequencies of a response are found from its poles up to {value} storage "
    "elements",
)
UNASKED_RESULTS = Limit(
    200, "beside responses other results are computed unasked up to {value} storage elements"
)
EXACT_IRRATIONAL = Limit(
    60, "exact zeros and poles of irrational values up to {value} storage elements, floating-point above"
)
LOOKING_AHEAD = Limit(800, "causality is assigned looking ahead on loops of up to {value} junctions")
STRUCTURES_IN_GRAPHS = Limit(200, "structures of up to {value} DOFs enter a bond graph by all of them")
DENSE_EQUILIBRIUM = Limit(
    1500, "singular equations of an equilibrium are decomposed up to {value:,} variables"
)
TRACED_PARTS = Limit(
    100, "the steps of a reduction are written unasked where fields and structures have up to {value} nodes"
)

TRACED_LOOPS = Limit(4, "the steps of a reduction are written unasked on up to {value} loops")

# Time responses.
HOLD: Default[Literal["spline"]] = Default("spline", "propagation", "samples are joined by a cubic {value}")
LONG_STEPS = Limit(60, "exponentials over many steps are made to all digits of up to {value} states")

COMMON_SAMPLES = Limit(1000, "loops of several sample times come together after at most {value:,} samples")
ANSWERS_UNDER_WAY = Limit(100, "answers of a sampled controller take up to {value} of its periods")

# Structures: modes, responses, bases.
DENSE_MODES = Default(200, "modes", "modes by dense matrices up to {value} DOFs")
ALL_MODES = Limit(4000, "all modes up to {value:,} DOFs; of more a number or a band is to be given")
FEW_MODES = Default(4, "many-modes", "by sparse Lanczos where at most one mode in {value} is requested")
FEW_FREQUENCIES = Default(
    6, "structure-response", "large sparse structures respond by modes at more than {value} frequencies"
)
DENSE_STRUCTURES = Limit(
    400, "structures of up to {value} DOFs are assembled dense, and respond by a solution at every frequency"
)
BACKEND = Default("ldl", "modes", "sparse matrices are factorised by {value}")
LARGE_MATRICES = Default(
    20_000,
    "modes",
    "without the C library, matrices of more than {value:,} rows are factorised by PARDISO where installed",
)
FULL_ROWS = Default(
    60,
    "modes-of-solids",
    "matrices as large with more than {value} entries a row, as those of solids, are factorised by PARDISO "
    "where installed",
)
MASTERS: Default[Literal["qr"]] = Default(
    "qr", "reduction", "masters are chosen by pivoted {value} of the modes"
)
MASTER_COORDINATES = Limit(
    1_000_000_000,
    "a reduced model is in the masters' displacements unless the energies of its modes are differences of "
    "terms {value:,} times as large, in its modes otherwise",
)
SINGLE_MASTERS = Limit(
    2000, "effective independence drops DOFs one by one once {value:,} are left, a quarter at a time before"
)
COMPARED_DOFS = Limit(
    20_000,
    "modes of the full structure that no basis holds are computed for comparisons up to {value:,} DOFs",
)
BASIS_BAND = Default(5.0, "basis", "a basis keeps all modes below {value:g} times the band of interest")
RESIDUALS: Default[Literal["auto"]] = Default(
    "auto", "residuals", "residual vectors ({value}) go with modes with joints, if the excitation has a band"
)

# Identification.
ESTIMATOR: Default[Literal["auto"]] = Default(
    "auto", "estimators", "{value}: a filter pass, of large records a fit of a part, then maximum likelihood"
)
FILTER_PASSES = Default(2, "estimators", "{value} passes of the filter")
LINEARISED = Default(
    1.0, "filters", "steps are linearised anew where a logarithm has moved by {value:g} of its deviation"
)
FORCING_TABLE = Limit(1_000_000, "kernels keep what signals force in a table of up to {value:,} numbers")
SHARED_DECAYS = Default(
    50_000_000,
    "wide-record",
    "channels share their free decays where derivatives by the state take {value:,} multiplications or more",
)
CALIBRATION = Level(
    3.0,
    "error bars are said not to include calibration errors where 1 % of a gain or a sample of delay moves an "
    "estimate by more than {value:g} standard errors",
)
MOST_STARTS = Limit(24, "an identification tries at most {value} starts besides the given one")
SEARCH_WORK = Limit(
    500_000_000_000,
    "a search of frequency responses takes at most {value:,} multiplications, or 64 evaluations",
)
RECORD_SEARCH_WORK = Limit(
    60_000_000_000,
    "a search of records of time takes at most {value:,} multiplications, or 256 evaluations",
)
BACKBONE_HARMONICS = Limit(
    20_000,
    "an identification from backbones solves motions of {value:,} harmonics in all for each point at most",
)
AGREEING_STARTS = Limit(5, "starts are drawn until {value} of them, and half of all, end at the best optimum")

SATURATED = Limit(128, "a saturated model has at most {value} regressors a channel besides the scene's own")

# Tests of residuals.
WHITENESS = Level(1e-6, "residuals are not white where their autocorrelation has p < {value:g}")
NOISE_CONTRADICTED = Level(
    1e-4, "a given noise is contradicted where chi-squared of the residuals has p < {value:g}"
)
NOISE_MATTERS = Level(1.05, "a given noise is contradicted only where it is off by a factor of {value:g}")
OUTLIER = Level(1e-4, "a sample is an outlier where the largest of as many Gaussian ones has p < {value:g}")
HEAVY_TAILS = Level(1e-6, "residuals have heavy tails where their kurtosis has p < {value:g}")
RESIDUAL_GROWTH = Level(
    1e-6, "residuals grow with the response where the rank correlation of their sizes has p < {value:g}"
)
OFFSET = Level(1e-6, "a channel has an offset where the mean of its residual has p < {value:g}")
NOISE_VALUES = Level(
    10, "an autoregression of noise has at least {value} stretches without a gap a coefficient"
)
HUBER = Level(1.345, "Huber's loss bounds residuals beyond {value:g} robust standard deviations")

# Verdicts of an identification.
SIGNAL = Level(1e-4, "a record shows a response where 'no response' has a probability below {value:g}")
LACK_OF_FIT = Level(
    1e-3,
    "a model lacks fit where its residuals beside the saturated model's have a probability below {value:g}",
)
NONLINEAR = Level(
    1e-3, "joints are nonlinear where the score test of linear ones has a probability below {value:g}"
)
EXPLAINED = Level(
    0.95, "a model that lacks fit explains a record nevertheless where it explains {value:g} of its signal"
)
RESOLVED = Level(
    4.0, "a number of the saturated model is resolved where it exceeds {value:g} times its deviation"
)

#: All default choices, by name.
CHOICES: dict[str, Default[object]] = {
    name.lower(): value for name, value in globals().items() if isinstance(value, Default)
}
#: All limits of cost, by name.
LIMITS: dict[str, Limit[object]] = {
    name.lower(): value for name, value in globals().items() if isinstance(value, Limit)
}

#: All levels of statistical decisions, by name.
LEVELS: dict[str, Level[object]] = {
    name.lower(): value for name, value in globals().items() if isinstance(value, Level)
}


def of_benchmark(name: str) -> list[str]:
    """Return the sentences of the choices that a benchmark justifies."""
    return [
        choice.sentence.format(value=choice.value) for choice in CHOICES.values() if choice.benchmark == name
    ]
