"""Errors and warnings of training runs."""


class TrainingError(ValueError):
    """An environment, folder or checkpoint that a run cannot use; the message says what is expected and found."""


class ShortRunWarning(UserWarning):
    """A run of so few updates that its policy hardly changes."""


class UnitWarning(UserWarning):
    """Numbers of an observation that vary by so little in their unit that the policy does not see them."""


class ResumeWarning(UserWarning):
    """A run that resumes from a checkpoint, but will not end with the same numbers as an uninterrupted one."""
