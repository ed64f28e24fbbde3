"""Parameter studies: one scene, many values."""
