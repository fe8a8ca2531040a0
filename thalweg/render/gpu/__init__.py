"""Frames on a GPU: kernels of one thread a pixel, made of the functions that the CPU's spans are made of."""
