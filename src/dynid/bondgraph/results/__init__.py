"""The results of bond graph analyses, written into a `Result`, one kind a file."""
