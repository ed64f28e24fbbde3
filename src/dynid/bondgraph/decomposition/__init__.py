"""A graph decomposed at a port: its two sides, the dynamics of the prototype there, the source's line."""
