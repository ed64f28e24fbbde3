"""Static condensation.

Sources: R. J. Guyan, AIAA J. 3 (1965) 380; B. Irons, AIAA J. 3 (1965) 961–962.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from dynid.lti.floating import guarded
from dynid.structure.matrices import Array, Label
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.reduction import Reduction, masters_alone, projected, with_known_joints
from dynid.structure.reduction.selection import Interest
from dynid.structure.reduction.static import Partition, partition, solver

FREE = "the slaves move freely while the masters are held: they do not follow statically"
REMEDY = "Make a DOF of the part that moves a master; unknown joints do not hold it here."


@dataclass(frozen=True)
class Guyan:
    """Static condensation: slaves follow the masters without inertia, ``x_s = -K_ss^-1 K_sm x_m``.

    Exact at rest, for loads on the masters. Joints that are known are part of the stiffness, others are not;
    for joints between masters this makes no difference.

    Parameters
    ----------
    masters
        Labels, or a rule to choose by. Absent: the DOFs of joints, sensors and loads.
    interest
        What the model is for.
    """

    masters: Sequence[Label] | Masters | None = None
    interest: Interest = field(default_factory=Interest)

    @guarded("the static condensation")
    def reduce(self, model: StructuralModel) -> Reduction:
        """Reduce a structure.

        Raises
        ------
        UsageError
            If masters do not exist or stand twice.
        Singular
            If the slaves are not held by the masters.
        """
        cut = partition(model, masters_alone(model, self.masters, self.interest))
        return Reduction(projected(model, cut.basis(constraint_modes(cut)), cut.labels), cut.labels)


def constraint_modes(cut: Partition) -> Array:
    """Return how the slaves follow unit displacements of the masters statically (s x m)."""
    K = with_known_joints(cut.model)[2]
    return -solver(cut.inner(K), FREE, REMEDY)(cut.coupling(K))
