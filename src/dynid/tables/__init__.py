"""Readers of tables of numbers in users' files: text, HDF5, MATLAB and Universal File Format 58."""
