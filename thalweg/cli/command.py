"""`Command`: what the commands have in common, and what is said of an interrupted one."""

from contextvars import ContextVar
from pathlib import Path

COMMAND_LINE: ContextVar[str] = ContextVar("COMMAND_LINE", default="thalweg")
"""The command that runs, as it is typed."""
NO_CHECKPOINT = "There was no checkpoint yet; the same command starts from the beginning."
NOTHING_SAVED = "Nothing was saved; the same command starts from the beginning."


class Command:
    """A command, whose fields are its options."""

    resumes = False
    """Whether the same command resumes."""

    def run(self) -> int:
        """Do the work; returns the exit status."""
        raise NotImplementedError

    def after_interrupt(self) -> str:
        """Return what becomes of the command when it was interrupted, as a sentence for people."""
        return "The same command resumes from the last checkpoint." if self.resumes else NOTHING_SAVED


def after_checkpoint(out: Path | None) -> str:
    """Return what becomes of an interrupted training in the folder of a run."""
    from thalweg.train.folder.checkpoint import newest_step

    step = None if out is None else newest_step(out)
    if step is not None:
        return f"The same command resumes from step {step:,}."
    return NO_CHECKPOINT
