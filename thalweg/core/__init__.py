"""Foundations that know no river: atomic files, compilation, devices, threads, caches and versions."""
