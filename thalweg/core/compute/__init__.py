"""Kernels: their compiler, their threads, and the devices that they run on."""
