"""Kernels for depth, class and water mask without colours."""
