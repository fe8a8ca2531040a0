"""Kernels for props: solids, their poses, their light, and the water around them."""
