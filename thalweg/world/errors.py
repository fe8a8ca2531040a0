"""Errors of lines, levels and files from which no world can be made."""


class WorldError(ValueError):
    """A line or level from which no safe river can be made; the message names the position and the limit."""


class ShapeError(WorldError):
    """A line that crosses itself, or bends too tightly to be flown or for its width; smoothing it may help."""


class WorldFileError(WorldError):
    """A file that is not a complete world of this format; the message names the path and the fault."""
