"""Lenses: models of their distortion, and the undistorted frames that their images are taken from."""
