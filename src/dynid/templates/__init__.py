"""Template scenes for `dynid new`, one a file."""
