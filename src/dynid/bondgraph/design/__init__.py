"""Design: parameters of a graph for which zeros and poles are where they are wanted, and norms are least."""
