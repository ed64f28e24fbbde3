"""Linear time-invariant systems: signals, exact propagation, frequency response, zeros and poles."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid.lti.certified_roots import roots
    from dynid.lti.pencil.zeros_poles import zeros_poles

__all__ = ["roots", "zeros_poles"]


def __getattr__(name: str) -> Any:
    """Import zeros, poles and roots at their first use: most scenes need the signals alone."""
    if name == "roots":
        from dynid.lti.certified_roots import roots

        return roots
    if name == "zeros_poles":
        from dynid.lti.pencil.zeros_poles import zeros_poles

        return zeros_poles
    raise AttributeError(f"module 'dynid.lti' has no attribute {name!r}")
