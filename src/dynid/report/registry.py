"""Registry of figures: the families of figures, and the results that have them.

A family is a function that yields `Figure`s of a result. Its module is imported only for results to which it
applies, and a figure is drawn only on demand. New figures are added to `FAMILIES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING

from dynid.errors import DynidError
from dynid.report.figure import Figure, Picture

if TYPE_CHECKING:
    from dynid.result import Result


@dataclass(frozen=True)
class FigureFamily:
    """Figures of one kind, and the condition on results that have them; all given parts must hold.

    Parameters
    ----------
    function
        The function that yields them, as `module:name`.
    kinds
        Kinds of results; empty: all.
    paths
        Beginnings of paths, one of which an array of the result has; empty: no condition.
    scene
        True if the result must hold the text of its scene.
    derivation
        True if they show how a result was derived.
    """

    function: str
    kinds: tuple[str, ...] = ()
    paths: tuple[str, ...] = ()
    scene: bool = False
    derivation: bool = False

    def applies(self, result: Result) -> bool:
        """Return True if a result may have such figures."""
        if self.scene and not result.attrs.get("scene"):
            return False
        if self.kinds and result.kind not in self.kinds:
            return False
        return not self.paths or any(path.startswith(self.paths) for path in result)


FREQUENCY_RESPONSES = (
    "bond_graph/frequency_response/",
    "structure/frequency_response/",
    "bond_graph/port/frequency_response/",
)
_DRAWING, _DIAGRAMS = "dynid.report.drawing", "dynid.report.diagrams"

#: In the order in which a page shows them.
FAMILIES: tuple[FigureFamily, ...] = (
    FigureFamily(f"{_DRAWING}.bond_graph:figures", kinds=("bond-graph", "identification"), scene=True),
    FigureFamily(f"{_DRAWING}.bond_graph:realisations", paths=("synthesis/form",)),
    FigureFamily(
        f"{_DRAWING}.bond_graph:reduction_strips",
        paths=("bond_graph/reduction/steps",),
        scene=True,
        derivation=True,
    ),
    FigureFamily(
        f"{_DRAWING}.prototype:prototypes",
        paths=("bond_graph/reduction/prototype", "bond_graph/port/"),
        derivation=True,
    ),
    FigureFamily(f"{_DRAWING}.structure:figures", kinds=("identification", "reduction"), scene=True),
    FigureFamily(f"{_DRAWING}.space:figures", paths=("structure/geometry/",), scene=True),
    FigureFamily(f"{_DRAWING}.prototype:equivalents", paths=("bond_graph/port/prototype",)),
    FigureFamily(f"{_DIAGRAMS}.responses:designed_responses", paths=("bond_graph/design/",)),
    FigureFamily(f"{_DIAGRAMS}.responses:figures", paths=FREQUENCY_RESPONSES),
    FigureFamily(f"{_DIAGRAMS}.poles:figures", paths=("bond_graph/transfer_function/",)),
    FigureFamily(f"{_DIAGRAMS}.feedback:figures", paths=("bond_graph/margins/",)),
    FigureFamily(
        f"{_DIAGRAMS}.responses:time_responses",
        paths=("bond_graph/time_response/", "structure/time_response/"),
    ),
    FigureFamily(f"{_DIAGRAMS}.identification:figures", paths=("identification/parameters/",)),
    FigureFamily(f"{_DIAGRAMS}.modes:figures", paths=("identification/modes/",)),
    FigureFamily(
        f"{_DIAGRAMS}.identification:predictions",
        paths=("identification/measurement/", "identification/diagnostics/"),
    ),
    FigureFamily(
        f"{_DIAGRAMS}.identification:histories",
        paths=("identification/history/", "identification/first_pass/", "identification/states/"),
    ),
    FigureFamily(
        f"{_DIAGRAMS}.responses:identified_responses", paths=("identification/derived/frequency_response/",)
    ),
    FigureFamily(f"{_DIAGRAMS}.reduction:figures", paths=("reduction/method",)),
    FigureFamily(f"{_DIAGRAMS}.plan:figures", paths=("plan/",)),
    FigureFamily(f"{_DIAGRAMS}.modes:measured_shapes", paths=("structure/geometry/shape_sensor",)),
    FigureFamily(f"{_DIAGRAMS}.mode_shapes:figures", paths=("structure/modes/shape",), scene=True),
    FigureFamily(f"{_DIAGRAMS}.work_precision:figures", paths=("bench/", "accuracy/")),
    FigureFamily(f"{_DIAGRAMS}.study_samples:figures", kinds=("study",)),
    FigureFamily(f"{_DIAGRAMS}.study_influence:figures", kinds=("study",)),
    FigureFamily(f"{_DIAGRAMS}.poles:root_loci", kinds=("study",)),
    FigureFamily(f"{_DRAWING}.prototype:performance", paths=("bond_graph/port/performance/",)),
)


def figures(result: Result) -> list[Figure]:
    """Return the figures of a result, none of them drawn yet.

    Parameters
    ----------
    result
        Of a run, or read back from its file.

    Returns
    -------
    list of Figure
        Their names are unique. A family that cannot list its figures is one figure, which raises the error
        when it is drawn.
    """
    found: dict[str, Figure] = {}
    for family in FAMILIES:
        if family.applies(result):
            for figure in _figures_of(family, result):
                if figure.name in found:
                    raise ValueError(f"two figures are called '{figure.name}'")
                found[figure.name] = figure
    return list(found.values())


#: Beginnings of the names of the figures that answer a kind of scene, the most important first.
_LEADING = {
    "bond-graph": ("design", "bode", "loop-nyquist", "poles", "time-response", "nyquist", "bond-graph"),
    "identification": (
        "estimates",
        "fit",
        "prediction",
        "measured-modes",
        "correlation",
        "bode",
        "time-response",
        "modes",
        "structure",
    ),
    "reduction": ("reduction-frf", "reduction-frequencies", "mac"),
    "study": ("distributions", "root-locus", "tornado", "map", "scatter"),
    "synthesis": ("bond-graph",),
    "plan": ("sensors", "excitation"),
}
#: Most figures that stand beside the answer.
_MOST = 3


def leading(kind: str, every: Sequence[Figure]) -> list[Figure]:
    """Return the figures that answer a result of a kind: at most three, one of each family."""
    found = []
    for start in _LEADING.get(kind, ("",)):
        found += [figure for figure in every if figure.name.startswith(start)][:1]
    return found[:_MOST]


def _figures_of(family: FigureFamily, result: Result) -> list[Figure]:
    module, _, name = family.function.partition(":")
    build: Callable[[Result], Iterable[Figure]] = getattr(import_module(module), name)
    try:
        return [replace(figure, derivation=family.derivation) for figure in build(result)]
    except DynidError as error:
        name, problem = module.rpartition(".")[2], error

        def fail() -> Picture:
            raise problem

        return [Figure(name, f"Figure: {name}", fail)]
