"""Levels of each vehicle: those that it is evaluated on by default, and that can be chosen to fly in."""

LEVELS_OF: dict[str, tuple[str, ...]] = {
    "uav": ("Easy", "Medium", "Hard"),
    "asv": ("Easy", "Medium-Deep", "Hard-Deep"),
}
"""Levels by vehicle, from the easiest on; those of the boat are deep enough for its draught."""
