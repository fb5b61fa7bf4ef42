"""TinySplat's reference side: networks, transforms, training and evaluation in torch. The runtime never imports it."""
