"""Class ids of the pixels in the class layer of a frame."""

SKY, WATER, GROUND, PLANT, BRIDGE = range(5)
SWIMMER, KAYAK, BUOY, STATION = range(5, 9)
"""Of props, see `thalweg.render.records.props`."""

CLASSES = ("sky", "water", "ground", "plant", "bridge", "swimmer", "kayak", "buoy", "station")
"""Name of each id."""
