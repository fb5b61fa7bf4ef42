"""3D Gaussians as data: the type, its algebra, its planes, and what is done to it."""

REMOVE, MAP = "remove", "map"
"""What is done with floaters (`clean.py`): they are removed, or painted so that one sees what would go."""

OWN_VARIANCE = 0.16
"""Own pixels² that Gaussians are widened by for other viewers (`footprints.widened`): the best of 0.04 to 0.3 at
twice the coded size."""
