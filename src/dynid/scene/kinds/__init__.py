"""Runs of each kind of scene: from its model to an analysis, and to a result."""
