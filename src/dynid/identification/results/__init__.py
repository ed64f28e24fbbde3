"""Identifications as named arrays."""
