"""Pages of results as HTML: self-contained, without network access, complete without scripts."""

from dynid.report.page.document import page

__all__ = ["page"]
