"""The error of data sets."""


class DatasetError(ValueError):
    """A data set that cannot be written or read, or does not fit what it is wanted for."""
