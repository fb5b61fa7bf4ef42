"""Photos and the cameras that took them: what a network is given."""
