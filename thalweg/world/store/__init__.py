"""Worlds on disk: the `.npz` format and the cache of built worlds."""
