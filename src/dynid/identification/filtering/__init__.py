"""The filter of the augmented state: one pass, in NumPy or compiled."""
