"""What goes wrong in asking for frames?"""


class RenderError(ValueError):
    """A camera, pose, look or range that cannot be drawn; the message names the value and what would be right."""
