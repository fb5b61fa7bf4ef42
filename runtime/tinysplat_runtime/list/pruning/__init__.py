"""Leaving out Gaussians that pictures hardly need; needs numba (`tinysplat[fast]`)."""
