"""The equations of a graph as a differential-algebraic system, and their exact index reduction."""
