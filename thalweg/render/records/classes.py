"""Class ids of the pixels in the class layer of a frame."""

SKY, WATER, GROUND, PLANT, BRIDGE = range(5)

CLASSES = ("sky", "water", "ground", "plant", "bridge")
"""Name of each id."""
