"""The ways to estimate, one a file."""
