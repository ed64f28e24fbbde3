"""Natural frequencies, mode shapes and modal damping; none is missed."""

from dynid.structure.modes.modes import Modes, modes, solver_for

__all__ = ["Modes", "modes", "solver_for"]
