"""Levels that each vehicle is evaluated on and flown in, where none are named."""

LEVELS_OF: dict[str, tuple[str, ...]] = {
    "uav": ("Easy", "Medium", "Hard"),
    "asv": ("Easy", "Medium-Deep", "Hard-Deep"),
}
"""Levels by vehicle, from the easiest on; those of the boat are deep enough for its draught."""
