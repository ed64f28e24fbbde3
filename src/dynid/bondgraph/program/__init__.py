"""Reduction programs: straight-line arithmetic, the numbers it runs on, and its compiler."""
