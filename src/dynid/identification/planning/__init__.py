"""Ranking of sensors and excitations by the information they give."""
