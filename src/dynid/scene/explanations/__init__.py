"""Explanations of scenes before they are run: causality, identifiability, and the cost of a trial run."""
