"""What runs each kind of scene: from words to the analyses and back to a result."""
