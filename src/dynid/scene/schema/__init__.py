"""Models of the keys of scenes, and their faults with the place of each."""
