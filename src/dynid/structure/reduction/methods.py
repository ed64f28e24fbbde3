"""All reduction methods by name."""

from __future__ import annotations

from typing import Any, Protocol

from dynid.errors import UsageError
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.condensation import Dynamic, Guyan
from dynid.structure.reduction.craig_bampton import CraigBampton
from dynid.structure.reduction.irs import Irs
from dynid.structure.reduction.modal import ModalTruncation
from dynid.structure.reduction.reduction import StructuralReduction
from dynid.structure.reduction.serep import JointAware, Serep
from dynid.suggestions import did_you_mean


class Reductor(Protocol):
    """A method with its choices made."""

    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure."""


METHODS: dict[str, Any] = {
    "serep": Serep,
    "guyan": Guyan,
    "dynamic": Dynamic,
    "irs": Irs,
    "craig-bampton": CraigBampton,
    "modal": ModalTruncation,
    "joint-aware": JointAware,
}
"""The classes of the methods: `Reductor` instances."""


def reduce(model: StructuralModel, method: str = "serep", **options: Any) -> StructuralModel:
    """Reduce a structure to a model of the same kind.

    Parameters
    ----------
    model
        The full structure. Its joints come along: their patterns are projected with everything else, so
        that unknown parameters stay unknown.
    method
        ``serep``, ``guyan``, ``dynamic``, ``irs``, ``craig-bampton``, ``modal`` or ``joint-aware``.
    options
        Those of the method's class.

    Returns
    -------
    StructuralModel
        The reduced model; any DOF of the full one can be loaded and read in it, and it expands back.

    Raises
    ------
    UsageError
        If masters or modes do not exist, stand twice, or the modes are more than the masters.
    Singular
        If a mode is invisible at the masters, or the slaves are not held by them.

    Examples
    --------
    >>> from dynid.structure.lumped import Link, lumped
    >>> chain = lumped([1, 1, 1], [Link((1,), 1.0), Link((1, 2), 1.0), Link((2, 3), 1.0)])
    >>> reduce(chain, "guyan", masters=[3]).K
    array([[0.33333333]])
    """
    if method not in METHODS:
        raise UsageError(
            f"there is no reduction method {method!r}{did_you_mean(method, METHODS)}",
            remedy=f"Use one of {', '.join(METHODS)}.",
        )
    reductor: Reductor = METHODS[method](**options)
    return reductor.reduce(model).model
