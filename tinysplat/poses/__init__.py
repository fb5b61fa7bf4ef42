"""Cameras found from pictures alone: frames of a video chosen, photos placed by COLMAP, scene folders written."""
