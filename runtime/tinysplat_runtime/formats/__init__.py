"""Gaussian files of other tools, a module a format."""
