"""The floating-point engine: roots of large graphs as eigenvalues; counts, orders and gains exact."""
