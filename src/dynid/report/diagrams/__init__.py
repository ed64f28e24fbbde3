"""The plots of results, a family a module."""
