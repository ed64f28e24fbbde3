"""Linear time-invariant systems: signals, exact propagation, frequency response, zeros and poles."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid.lti.certified_roots import roots
    from dynid.lti.pencil.zeros_poles import zeros_poles

__all__ = ["roots", "zeros_poles"]


def __getattr__(name: str) -> Any:
    """Import zeros, poles and roots at their first use: most scenes need the signals alone."""
    modules = {"roots": "certified_roots", "zeros_poles": "pencil.zeros_poles"}
    if name in modules:
        return getattr(import_module(f"dynid.lti.{modules[name]}"), name)
    raise AttributeError(f"module 'dynid.lti' has no attribute {name!r}")
