"""What the analyses of a graph put into a `Result`, one question a file."""
