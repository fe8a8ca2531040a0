"""Policies: networks, action spaces, distributions, memory and files."""
