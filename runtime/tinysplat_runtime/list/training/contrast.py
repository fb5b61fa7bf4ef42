"""How much a photo shows where, which tells how many Gaussians it asks for."""

import numpy as np
from numpy.typing import NDArray


def smoothed(plane: NDArray) -> NDArray:
    """(H, W), the mean of 3×3 neighbours."""
    padded = np.pad(plane, 1, mode="edge")
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9


def contrast(photo: NDArray) -> NDArray:
    """(H, W): how much grey changes to the right and below, smoothed."""
    grey = np.nan_to_num(photo.mean(axis=-1))
    across = np.abs(np.diff(grey, axis=1, append=grey[:, -1:]))
    return smoothed(across + np.abs(np.diff(grey, axis=0, append=grey[-1:])))
