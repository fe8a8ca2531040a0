"""The error of exports and of the files they write."""


class ExportError(ValueError):
    """A policy that cannot be exported faithfully, or an exported file that cannot be used."""
