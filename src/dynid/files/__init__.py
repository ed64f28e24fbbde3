"""Readers of matrices in users' files; extension and header choose the format."""
