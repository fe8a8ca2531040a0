"""Compiled kernels that render one frame on the CPU."""
