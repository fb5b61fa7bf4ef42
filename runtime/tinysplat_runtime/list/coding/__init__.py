"""Sorted along a curve and by what they weigh in pictures, coded as planes, tier by tier."""
