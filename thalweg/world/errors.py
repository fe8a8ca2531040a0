"""What can be wrong with a line, a level or a file of a world?"""


class WorldError(ValueError):
    """A line or level from which no safe river can be made; the message says where and which limit."""


class ShapeError(WorldError):
    """A line that crosses itself, or bends too tightly to be flown or for its width: rounding it may mend it."""


class WorldFileError(WorldError):
    """A file that is no whole world of this format; the message names the path and what is wrong."""
