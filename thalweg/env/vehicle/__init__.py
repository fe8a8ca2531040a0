"""Vehicles other than the UAV: the boat, its hull against ground, stones and bridges, and the water that carries it."""
