"""Diagnoses of an estimate: intervals, verdict, mistakes of instruments, other optima, model error."""
