"""Natural frequencies, mode shapes and modal damping, with none missed."""

from dynid.structure.modes.solution import Modes
from dynid.structure.modes.solve import modes, solver_for

__all__ = ["Modes", "modes", "solver_for"]
