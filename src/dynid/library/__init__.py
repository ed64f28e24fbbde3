"""Models of machines and components, with values and their sources."""
