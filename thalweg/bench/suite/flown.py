"""Policies that a suite flies without training: functions, and policies that were trained before."""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any

from pydantic import BeforeValidator, model_validator

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.functions import FunctionPolicy, is_reference
from thalweg.bench.evaluate.rivers import NAME
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.core.config import frozen_config, parse_config


@frozen_config(ResultsError)
class Function:
    """A function that is flown without training, see `thalweg.bench.evaluate.functions`."""

    function: str
    """A file or a module, and a name in it: `fly.py:fly`. It is loaded when the suite is constructed."""
    name: str = ""
    """Name of its results; if empty, that which the function has itself."""

    @model_validator(mode="after")
    def _check(self) -> "Function":
        if not is_reference(self.function):
            raise ValueError(
                f"function must be a file or a module, and a name in it, such as fly.py:fly, got {self.function!r}"
            )
        self.policy  # noqa: B018  raises the error of one that cannot be loaded
        return self

    @cached_property
    def policy(self) -> FunctionPolicy:
        """The function as a policy."""
        return FunctionPolicy.load(self.function, self.name)

    @property
    def label(self) -> str:
        return self.policy.name

    @property
    def seeds(self) -> tuple[int, ...]:
        """The only seed of its results: functions draw nothing."""
        return (0,)

    @property
    def observation(self) -> str:
        """What it sees, see `thalweg.train.observations`."""
        return self.policy.observation

    def as_data(self) -> dict[str, str]:
        """Return plain data for JSON. Version and source are no part of the suite: results that they outdate are done
        again."""
        return {"function": self.function, "name": self.label, "observation": self.observation}

    def __getstate__(self) -> dict[str, str]:
        """Return what is sent to another process, which loads the function itself."""
        return {"function": self.function, "name": self.name}


def _files(value: Any) -> tuple[PolicyFile, ...]:
    """Return the policies of one name or path, or of several."""
    return tuple(map(PolicyFile.of, value if isinstance(value, list | tuple) else (value,)))


@frozen_config(ResultsError)
class SavedPolicy:
    """A policy that was trained before, flown as it is; of several files, each is a seed of it."""

    policy: Annotated[tuple[Any, ...], BeforeValidator(_files)]
    """Runs' folders, policy files, `packaged-rgb`; one, or several, which are the seeds 0, 1, ... in their order. They
    are loaded when the suite is constructed, and results belong to their content."""
    name: str = ""
    """Name of its results; if empty, that of the first folder, or of the first file without its ending."""

    @model_validator(mode="after")
    def _check(self) -> "SavedPolicy":
        if not self.policy:
            raise ValueError("policy names no file; give a run's folder, a policy file or packaged-rgb")
        if any(file.is_packaged for file in self.policy):
            raise ValueError("the policy packaged is flown with packaged: true, not among other policies")
        if not NAME.fullmatch(self.label):
            raise ValueError(f"a policy is called {self.label!r}; give it a name of letters, digits, - and .")
        for what in ("observation", "encoder", "is_taught"):
            found = [getattr(file, what) for file in self.policy]
            for file, other in zip(self.policy, found, strict=True):
                if other != found[0]:
                    words = what.replace("_", " ")
                    raise ValueError(
                        f"{self.label}: the {words} of {self.policy[0].given} is {found[0]}, that of {file.given}"
                        f" {other}; seeds of one policy differ in nothing but the seed: name them apart"
                    )
        contents = [file.content for file in self.policy]
        for file in self.policy:
            if contents.count(file.content) > 1:
                raise ValueError(f"{self.label}: {file.given} is named twice")
        return self

    @property
    def label(self) -> str:
        return self.name or self.policy[0].name

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of its results, the places of its files."""
        return tuple(range(len(self.policy)))

    @property
    def observation(self) -> str:
        """What it sees, see `thalweg.train.observations`."""
        return self.policy[0].observation

    @property
    def encoder(self) -> str | None:
        """Name of the encoder whose codes it sees; None if it sees none."""
        return self.policy[0].encoder

    def as_data(self) -> dict[str, Any]:
        """Return plain data for JSON: of each file its name and content."""
        coded = {} if self.encoder is None else {"encoder": self.encoder}
        files = [{"file": file.name, "content": file.content} for file in self.policy]
        taught = self.policy[0].is_taught
        return {"policy": files, "name": self.label, "observation": self.observation, "taught": taught} | coded


Flown = Function | SavedPolicy


def flown(value: Any) -> Any:
    """Return the function or the policy of a text or a mapping; anything else unchanged.

    Raises the errors of `Function` and `SavedPolicy`.
    """
    if isinstance(value, str):
        return Function(value) if is_reference(value) else SavedPolicy((PolicyFile.of(value),))
    if isinstance(value, Mapping):
        return parse_config(SavedPolicy if "policy" in value else Function, value)
    return value
