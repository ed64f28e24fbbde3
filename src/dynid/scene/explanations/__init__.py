"""Explanations of scenes before they are run: causality, identifiability, cost."""
