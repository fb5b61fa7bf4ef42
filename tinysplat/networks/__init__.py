"""Feedforward networks: posed images in, per-pixel Gaussians out."""
