"""Kinds of policies that are ranked among themselves, each in a table of its own."""

from collections.abc import Callable
from dataclasses import dataclass

from thalweg.bench.leaderboard.policy_entry import PolicyEntry

TAUGHT_NOTE = """These policies learnt from a pilot that knows the map before anything else, so they are ranked among
themselves. The packaged policy was imitated on other rivers than these, in more steps than a row may have, and is flown
once from every start, so that it has no interval over seeds. Other policies of files are flown in the same way, each
file as a seed; on which rivers they learnt, and in how many steps, is not known here. Rows with steps began with a
policy of these kinds, and their steps are those after it."""
PRIVILEGED_NOTE = """These policies see what a perfect camera could tell instead of frames, so they are ranked among
themselves."""
FUNCTIONS_NOTE = """Functions, and policies that were trained before, flown as they are, once from every start; each
file of a policy is a seed. *Versions* has the version and the hash of the source of each function."""


@dataclass(frozen=True)
class Kind:
    """Policies of one kind."""

    title: str
    note: str
    includes: Callable[[PolicyEntry], bool]
    """Whether a policy is of the kind."""


def sees_frames(entry: PolicyEntry) -> bool:
    """Return whether a policy was trained here, by no teacher, and sees frames or images: those that come first."""
    return _is_trained_alone(entry) and not entry.privileged


def _is_trained_alone(entry: PolicyEntry) -> bool:
    return entry.trained and not entry.taught


TAUGHT = Kind("Imitated, and trained from an imitated policy", TAUGHT_NOTE, lambda entry: entry.taught)
PRIVILEGED = Kind(
    "With the privileged observation",
    PRIVILEGED_NOTE,
    lambda entry: _is_trained_alone(entry) and entry.privileged,
)
FUNCTIONS = Kind("Not trained here", FUNCTIONS_NOTE, lambda entry: not (entry.trained or entry.taught))
APART = (TAUGHT, PRIVILEGED, FUNCTIONS)
"""All kinds but the first, in the order of the page."""
