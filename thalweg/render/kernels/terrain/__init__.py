"""Kernels that find where rays meet the ground and the water."""
