"""Lists, Gaussians that are pixels of no view: how they are trained from photos, pruned, and coded."""
