"""Natural frequencies, mode shapes and modal damping; none is missed."""

from dynid.structure.modes.modes import ModeMemory, Modes, modes, remembered_modes, solver_for

__all__ = ["ModeMemory", "Modes", "modes", "remembered_modes", "solver_for"]
