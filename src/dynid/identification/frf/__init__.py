"""Identification from measured frequency response functions."""
