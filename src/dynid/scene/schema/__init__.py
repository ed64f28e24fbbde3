"""Schema of scenes: models of their keys, and all faults of a scene with their places."""
