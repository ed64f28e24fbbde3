"""Measurements and their data, and the likelihood of one record of each kind."""
