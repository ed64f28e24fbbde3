"""What a scene may say, and every way in which it can be wrong."""
