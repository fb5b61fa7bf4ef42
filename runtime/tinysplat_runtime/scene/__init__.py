"""Photos and the cameras that took them: what a network is given."""

MOVING, BACKGROUND = "moving", "background"
"""What masks show: what moves, which other photos may see behind, or where nothing is at all."""
