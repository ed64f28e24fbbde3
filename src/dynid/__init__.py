"""dynid: bond graphs in the frequency domain, and joint identification on reduced FE models."""

from dynid._version import __version__

__all__ = ["__version__"]
