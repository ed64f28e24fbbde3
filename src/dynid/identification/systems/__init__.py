"""Models with unknown parameters as linear systems: matrices, derivatives, steps and predictions."""
