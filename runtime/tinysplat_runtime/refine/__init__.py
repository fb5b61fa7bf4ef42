"""Render, look, correct: Gaussians that photos are drawn from again and again until they show them."""
