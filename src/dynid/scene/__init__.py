"""Scenes: YAML with positions, its schema, its expressions, and what runs each kind."""
