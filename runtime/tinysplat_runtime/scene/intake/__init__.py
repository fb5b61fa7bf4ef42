"""Scenes as other tools write them: nerfstudio and instant-ngp, COLMAP, RealEstate10K, plain stereo pairs.

Each module turns one layout into a `Scene`; `scenes.load_scene` tells the layouts apart. Nothing here decodes photos:
`Frame.image` does, and takes the lens out where a camera has distortion.
"""
