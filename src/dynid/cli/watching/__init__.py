"""Watching a scene: what changed, what came of it, and the page that shows it."""
