"""Causality: which end of every bond sets the effort, and what follows for states, loops and zeros."""
