"""What can be wrong with a run."""


class TrainingError(ValueError):
    """An environment, folder or checkpoint that a run can't use; says what was expected and what was found."""


class ResumeWarning(UserWarning):
    """A run that goes on from a checkpoint, but not to the same numbers as an unbroken one."""
