"""Policies that were trained before, as suites name them: by a name of the package, a run's folder or a policy file."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import PlainValidator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.packaged import PACKAGED, PACKAGED_POLICIES, PACKAGED_SEES, policy_path
from thalweg.core.cache import file_hash
from thalweg.encoder import encoder_plugin
from thalweg.train import load_policy
from thalweg.train.encoder_of_run import context_of, encoder_of, packaged_name
from thalweg.train.observations import FRAMES, is_taught, observation_of
from thalweg.train.run_in_folder import policy_file

DEFAULT = "default"
"""Encoder of policies of codes that do not name theirs."""


@dataclass(frozen=True)
class PolicyFile:
    """A policy of a file, which results name by its content.

    It pickles as what was given and the hash of the content: another process reads the file itself, and refuses one of
    another content. The policy `packaged`, which has a version in results and which a copy of the package may lack, is
    not read before it is needed.
    """

    given: str
    content: str
    """Hash of the file; empty for `packaged`."""

    @classmethod
    def of(cls, given: Any) -> "PolicyFile":
        """Return the policy of a name or path; raises `ResultsError` for anything that names none, and the errors of a
        policy that cannot be loaded."""
        if isinstance(given, cls):
            return given
        if given == PACKAGED:
            return cls(PACKAGED, "")
        if not isinstance(given, str) or not given:
            names = ", ".join(PACKAGED_POLICIES)
            raise ResultsError(f"must be a run's folder, a policy file, or one of {names}, got {given!r}")
        file = cls(given, "")
        found = cls(given, file_hash(file.path) if file.path.is_file() else "")
        found.policy  # noqa: B018  raises the error of one that cannot be loaded
        return found

    @property
    def path(self) -> Path:
        """File of the policy; raises `AlgorithmError` for a folder of a run that has not finished."""
        return policy_file(policy_path(self.given))

    @property
    def name(self) -> str:
        """Name of the package's policy, of the folder, or of the file without its ending."""
        path = Path(self.given)
        return self.given if self.given in PACKAGED_POLICIES else path.resolve().name if path.is_dir() else path.stem

    @property
    def is_packaged(self) -> bool:
        """Whether it is the policy whose version results name instead of its content."""
        return self.given == PACKAGED

    @cached_property
    def policy(self) -> Any:
        """The policy; raises the errors of `load_policy`."""
        return load_policy(self.path)

    @property
    def content_now(self) -> str:
        """Hash of the file as it is now; empty for `packaged`, and where there is none."""
        try:
            return "" if self.is_packaged else file_hash(self.path)
        except (AlgorithmError, OSError):
            return ""

    def unchanged(self) -> "PolicyFile":
        """Return it, if its file still has that content; raises `ResultsError` for another, or none."""
        if (found := self.content_now) != self.content:
            raise ResultsError(
                f"{self.given} has changed since the suite was read: its content was {self.content} and is"
                f" {found or 'gone'} now. Restore the old file, or choose another folder of results."
            )
        return self

    @property
    def observation(self) -> str:
        """What it sees, see `thalweg.train.observations`."""
        return PACKAGED_SEES if self.is_packaged else observation_of(self.policy)

    @property
    def is_taught(self) -> bool:
        """Whether it learnt from a teacher that knows the map, or its training began with one that did."""
        return self.is_packaged or is_taught(self.policy)

    @property
    def encoder(self) -> str | None:
        """Name of the encoder whose codes it sees; None if it sees none.

        Raises `ResultsError` for the file of an encoder of its own, and `TrainingError` for one that is not here.
        """
        if self.observation != FRAMES:
            return None
        digest = context_of(self.policy).get("encoder")
        if digest is None:
            return DEFAULT
        if (name := packaged_name(digest)) is not None:
            return name
        file = encoder_of(self.policy)
        if encoder_plugin(str(file)) is None:
            raise ResultsError(
                f"{self.given} sees the codes of {file}, but suites know only encoders of the package and of plug-ins:"
                " evaluate it by `thalweg evaluate`"
            )
        return str(file)

    def as_data(self) -> dict[str, Any] | str:
        """Return plain data for JSON: its name and content, and whether it was taught; of `packaged` the name alone."""
        return PACKAGED if self.is_packaged else {"file": self.name, "content": self.content, "taught": self.is_taught}

    def __getstate__(self) -> dict[str, str]:
        return {"given": self.given, "content": self.content}


def _begun(value: Any) -> PolicyFile | None:
    """Return the policy that an arm begins with; None for none, which may be empty text too."""
    if value is None or value == "":
        return None
    return PolicyFile.of(value)


Begun = Annotated[PolicyFile, PlainValidator(_begun)]
"""A policy to begin with, by name or path."""
