"""Shading kernels: ground, water, tone mapping and the reduced quality."""
