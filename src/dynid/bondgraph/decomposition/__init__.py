"""A graph decomposed at a port: its two sides, and the dynamics of the prototype there."""
