"""The error of the viewer."""


class ViewerError(ValueError):
    """A wish of the page that cannot be met, or a file of a flight that cannot be used; the message says why."""
