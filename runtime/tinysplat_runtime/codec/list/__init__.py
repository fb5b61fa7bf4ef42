"""Gaussians of no pixels: sorted along a curve and by what they weigh in pictures, coded as planes."""
