"""3D Gaussians as data: the type, its algebra, its planes, and what is done to it."""
