"""Likelihoods of records, and tests of a model against them."""
