"""The float engine: roots of large graphs as eigenvalues, with what can be known exactly kept exact."""
