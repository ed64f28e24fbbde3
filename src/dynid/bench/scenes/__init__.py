"""Speed against error of a user's own scene: what else could have been chosen, and how that does."""

from dynid.bench.scenes.measure import add_accuracy

__all__ = ["add_accuracy"]
