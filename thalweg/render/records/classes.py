"""What can a pixel show? The ids that frames carry in their class layer."""

SKY, WATER, GROUND, PLANT, BRIDGE = range(5)
