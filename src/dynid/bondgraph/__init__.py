"""Bond graphs: reduction to a prototype, transfer functions, state equations, responses."""
