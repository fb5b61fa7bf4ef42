"""Threads, memory, files and time: what a process has."""
