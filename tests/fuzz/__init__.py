"""Hostile input: scenes and files that nobody means well with."""
