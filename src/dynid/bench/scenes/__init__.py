"""Speed against error of a user's own scene: its choices and the alternatives to them."""

from dynid.bench.scenes.measure import add_accuracy

__all__ = ["add_accuracy"]
