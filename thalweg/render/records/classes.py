"""Class ids of the pixels in the class layer of a frame."""

SKY, WATER, GROUND, PLANT, BRIDGE = range(5)
