"""A result as one HTML page: no other files, no network, nothing hidden without scripts."""

from dynid.report.page.document import page

__all__ = ["page"]
