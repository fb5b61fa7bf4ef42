"""Gaussians that belong to no pixels: how they are trained from photos, pruned, and coded."""
