"""Many samples of one graph at once, which differ in the values of its elements."""
