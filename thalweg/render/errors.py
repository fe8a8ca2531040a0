"""`RenderError`, raised for frames that cannot be rendered."""


class RenderError(ValueError):
    """A camera, pose, look or range that cannot be drawn; the message names the value and what would be right."""
