"""Photos with cameras to Gaussians: a network on pairs, on groups, and on a capture photo by photo."""
