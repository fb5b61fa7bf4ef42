"""Gaussians to planes to bytes, and back: one transform and its inverse per module."""
