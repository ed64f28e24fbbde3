"""Joint identification: augmented filter, information bounds, diagnostics."""
