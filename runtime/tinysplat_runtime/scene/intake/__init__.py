"""Scenes read, our own and those of other tools: nerfstudio, instant-ngp, COLMAP, RealEstate10K, stereo pairs, video.

Each module turns one layout into a `Scene`; `layouts.load_scene` tells the layouts apart. Nothing here decodes photos:
`Frame.image` does, and takes the lens out where a camera has distortion.
"""
