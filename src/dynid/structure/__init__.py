"""Structures: mass, damping and stiffness with joints; modes and responses."""
