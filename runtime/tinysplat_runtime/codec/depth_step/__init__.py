"""How finely depth is coded: an error's damage to the picture, measured on the scene itself."""
