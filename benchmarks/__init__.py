"""Benchmarks against packages that no part of dynid uses."""
