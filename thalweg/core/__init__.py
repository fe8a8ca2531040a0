"""Foundations that know no river: atomic files, settings, caches and versions; in `compute`, kernels and devices."""
