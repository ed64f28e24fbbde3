"""Hard cases: each declared with its source, its known answer and the bound that it must meet."""
