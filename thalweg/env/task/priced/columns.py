"""Rows of objects that tasks put into a river, as the renderer takes them."""

COLUMNS = ("kind", "x", "y", "z", "yaw", "phase")
"""Columns of a row: the kind, the place (z: the water's level there, metres), the heading, and the phase of the
animation (radians)."""
SWIMMER, KAYAK, BUOY, STATION = 1, 2, 3, 4
"""Kinds; 0 is an empty row."""
