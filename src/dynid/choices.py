"""What the suite chooses where a scene leaves it open, and the benchmark whose table justifies it.

Code takes its thresholds from here; results, `dynid bench` and the documentation quote the same sentences.
To change one: run the benchmark it names, look at its table, and change the number. Of limits no table shows
a crossing: up to them the better way can be afforded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Default(Generic[T]):
    """A choice that the suite makes by default.

    Parameters
    ----------
    value
        The threshold, or what is chosen.
    benchmark
        The benchmark whose table justifies it: `dynid bench NAME` measures it now.
    sentence
        The choice in words; ``{value}`` stands for the value.
    """

    value: T
    benchmark: str
    sentence: str

    def __str__(self) -> str:
        return f"{self.sentence.format(value=self.value)} (bench {self.benchmark})"


@dataclass(frozen=True)
class Limit(Generic[T]):
    """A limit of cost: up to it the better way is taken, beyond it another, or the user is asked.

    Parameters
    ----------
    value
        The size.
    sentence
        The limit in words; ``{value}`` stands for the value.
    """

    value: T
    sentence: str

    def __str__(self) -> str:
        return self.sentence.format(value=self.value)


# Bond graphs: which engine.
EXACT_ROOTS = Default(
    400, "zeros-poles", "exact zeros and poles up to {value:,} storages, float above"
)  # fmt: skip
EXACT_POLYNOMIALS = Default(
    1000, "polynomials", "exact polynomials up to {value:,} storages where no roots are asked for"
)
MANY_LOOPS = Default(4, "loops", "junction structures with more than {value} loops have limits of their own")
EXACT_ROOTS_ON_LOOPS = Default(80, "loops", "exact zeros and poles up to {value} storages on many loops")
EXACT_POLYNOMIALS_ON_LOOPS = Default(150, "loops", "exact polynomials up to {value} storages on many loops")
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

SPARSE_REFINEMENT = Default(
    150, "pencils", "eigenvalues of sparse pencils are refined by sparse factors from {value} equations on"
)
SHARED_POLYNOMIALS = Limit(
    4000, "samples share polynomials of up to {value:,} terms; with more each is run on the shared plan"
)
LOOKING_AHEAD = Limit(800, "causality is assigned looking ahead on loops of up to {value} junctions")

# Time responses.
HOLD: Default[Literal["spline"]] = Default("spline", "propagation", "samples are joined by a cubic {value}")
LONG_STEPS = Limit(60, "exponentials over many steps are made to all digits of up to {value} states")

# Structures: modes, responses, bases.
DENSE_MODES = Default(200, "modes", "modes by dense matrices up to {value} DOFs")
ALL_MODES = Limit(4000, "all modes up to {value:,} DOFs; of more a number or a band is to be given")
FEW_MODES = Default(4, "many-modes", "by sparse Lanczos where at most one mode in {value} is asked for")
FEW_FREQUENCIES = Default(
    6, "structure-response", "large sparse structures respond by modes at more than {value} frequencies"
)
DENSE_STRUCTURES = Limit(
    400, "structures of up to {value} DOFs are assembled dense, and respond by a solution at every frequency"
)
BACKEND = Default("splu", "modes", "sparse matrices are factorised by {value}")
MASTERS: Default[Literal["qr"]] = Default(
    "qr", "reduction", "masters are chosen by pivoted {value} of the modes"
)
SINGLE_MASTERS = Limit(
    2000, "effective independence drops DOFs one by one once {value:,} are left, a quarter at a time before"
)
BASIS_BAND = Default(5.0, "basis", "a basis keeps all modes below {value:g} times the band of interest")
RESIDUALS: Default[Literal["auto"]] = Default(
    "auto", "residuals", "residual vectors ({value}) go with modes with joints, if the excitation has a band"
)

# Identification.
ESTIMATOR: Default[Literal["auto"]] = Default(
    "auto", "estimators", "{value}: a filter pass, then maximum likelihood"
)
FILTER_PASSES = Default(2, "estimators", "{value} passes of the filter")
LINEARISED = Default(
    1.0, "filters", "steps are linearised anew where a logarithm has moved by {value:g} of its deviation"
)
COMPILED = Default(
    10.0,
    "filters",
    "compiled kernels where a pass linearised at every sample would take more than {value:g} s without",
)
FORCING_TABLE = Limit(1_000_000, "kernels keep what signals force in a table of up to {value:,} numbers")

#: All of them, by name.
CHOICES: dict[str, Default[object]] = {
    name.lower(): value for name, value in globals().items() if isinstance(value, Default)
}
#: All limits of cost that choose a way, by name.
LIMITS: dict[str, Limit[object]] = {
    name.lower(): value for name, value in globals().items() if isinstance(value, Limit)
}


def of_benchmark(name: str) -> list[str]:
    """Return the choices that a benchmark justifies, in words."""
    return [each.sentence.format(value=each.value) for each in CHOICES.values() if each.benchmark == name]
