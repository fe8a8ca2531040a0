"""Class ids of the pixels in the class layer of a frame."""

SKY, WATER, GROUND, PLANT, BRIDGE = range(5)
SWIMMER, KAYAK, BUOY, STATION = range(5, 9)
"""Of props, see `thalweg.render.records.props`."""
CLASSES = 9
"""Number of classes."""
