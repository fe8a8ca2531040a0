"""Functions that fly: any callable from an observation to an action, as a policy that was not trained here.

A class is such a callable too: each episode then has an object of its own, which may remember what it saw.
"""

import functools
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from thalweg.algos.policy.policy_file import About
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.rivers import NAME
from thalweg.core import versions
from thalweg.core.plugins.loading import object_named
from thalweg.core.plugins.record import RESERVED
from thalweg.core.plugins.source import source_files, source_hash, text_hash
from thalweg.train.folder.run_record import PLUGIN
from thalweg.train.observations import BRANCHES, FRAMES, IMAGES, PRIVILEGED

OBSERVATIONS = (*IMAGES, PRIVILEGED, FRAMES)
"""What a function may see: images, the privileged observation, or the codes of an encoder."""
REFERENCE = re.compile(r".+:[^\W\d]\w*")
"""A file or a module, and a name in it."""
OPTIONS_OF_A_BRANCH = BRANCHES[0]
"""Options of each of the four branches of an action."""


class FunctionPolicy:
    """A callable as a policy; its attribute `about` says what it sees, and its version and source."""

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        name: str = "",
        version: int | None = None,
        observation: str = "",
        source: str = "",
        vehicle: str = "uav",
    ) -> None:
        """Raises `ResultsError` for anything that cannot fly.

        Args:
            function: Takes one observation, an image uint8 [H, W, C] or numbers float32 [D], and returns an action of
                four whole numbers 0, 1 or 2. A class is called without arguments at the start of each episode, and its
                object is the function. A `functools.partial` is the function with its arguments: these are part of the
                hash of its source.
            name: Name in results; by default the attribute `label` of the function, or its own name.
            version: Version of the function, 1 or more; by default its attribute `version`, or 1.
            observation: One of `OBSERVATIONS`; by default the attribute `observation` of the function, or `rgb+mask`.
            source: Hash of its source; by default that of its file and the modules beside it that it imports.
            vehicle: Vehicle that it steers.
        """
        if not callable(function):
            raise ResultsError(
                f"{function!r} cannot fly: a function is needed that takes an observation and returns an action"
            )
        self.function = function
        inner = _without_arguments(function)

        def said(attribute: str, default: Any) -> Any:
            return getattr(function, attribute, getattr(inner, attribute, default))

        name = name or said("label", "") or said("__name__", type(inner).__name__)
        version = said("version", 1) if version is None else version
        observation = observation or said("observation", IMAGES[0])
        _check(name, version, observation)
        seen: dict[str, Any] = {} if observation == FRAMES else {"observation": observation}
        seen |= {"render_version": versions.RENDER} if observation in IMAGES else {}
        seen |= {"privileged_version": versions.PRIVILEGED} if observation == PRIVILEGED else {}
        made = {PLUGIN: {"version": version, "source": source or _source_of(function, name)}}
        self.about = About(name, {}, {**seen, "env": {"vehicle": vehicle}, **made})

    @classmethod
    def load(cls, reference: str, name: str = "", vehicle: str = "uav") -> "FunctionPolicy":
        """Return the policy of a reference, `fly.py:fly` or `package.module:fly`; raises `PluginError` and
        `ResultsError`."""
        function, source = object_named(reference)
        return cls(function, name=name, source=source, vehicle=vehicle)

    @property
    def name(self) -> str:
        return self.about.algorithm

    @property
    def version(self) -> int:
        return self.about.context[PLUGIN]["version"]

    @property
    def source(self) -> str:
        return self.about.context[PLUGIN]["source"]

    @property
    def observation(self) -> str:
        return self.about.context.get("observation", FRAMES)

    def player(
        self, num_envs: int, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> "FunctionPlayer":
        """Return a player for N environments; functions draw nothing from the generator."""
        return FunctionPlayer(self.name, self.function, num_envs)


class FunctionPlayer:
    """A callable in N environments; of a class, each has an object of its own for each episode."""

    def __init__(self, name: str, function: Callable[..., Any], num_envs: int) -> None:
        self._name, self._function = name, function
        self._acts: list[Callable[..., Any]] = [function] * num_envs

    def __call__(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return actions int64 [N, 4]; raises `ResultsError` for anything else that the function returns."""
        if isinstance(self._function, type):
            self._acts = [self._function() if new else act for new, act in zip(fresh, self._acts, strict=True)]
        return np.stack([self._checked(act(row), row) for act, row in zip(self._acts, obs, strict=True)])

    def _checked(self, given: Any, row: np.ndarray) -> np.ndarray:
        action = np.asarray(given)
        whole = action.shape == (len(BRANCHES),) and action.dtype.kind in "iu"
        if not whole or action.min() < 0 or action.max() >= OPTIONS_OF_A_BRANCH:
            raise ResultsError(
                f"{self._name} returned {given!r} for an observation {row.dtype} {list(row.shape)}; an action is four"
                " whole numbers, each 0, 1 or 2: vertical, yaw, longitudinal, lateral"
            )
        return action.astype(np.int64)


def is_reference(text: str) -> bool:
    """Return whether a text names a function; one that is the path of something that exists does not."""
    return bool(REFERENCE.fullmatch(text)) and not Path(text).exists()


def _check(name: str, version: Any, observation: Any) -> None:
    """Raise `ResultsError` for a name, a version or an observation that cannot be."""
    if not NAME.fullmatch(name) or name in RESERVED:
        why = "is that of another version in results" if name in RESERVED else "must be letters, digits, - and ."
        raise ResultsError(f"the name {name!r} of a function {why}; give it a label, such as fly.label = 'Mine'")
    if type(version) is not int or version < 1:
        raise ResultsError(f"the version of {name} is {version!r}; it must be a whole number of 1 or more")
    if observation not in OBSERVATIONS:
        raise ResultsError(f"{name} sees {observation!r}; a function may see {', '.join(OBSERVATIONS)}")


def _without_arguments(function: Any) -> Any:
    """Return the callable inside a `functools.partial`, or of one in another; any other callable itself."""
    while isinstance(function, functools.partial):
        function = function.func
    return function


def _arguments_of(function: Any, name: str) -> str:
    """Return the arguments of a `functools.partial` as a text; empty for another callable."""
    text = ""
    while isinstance(function, functools.partial):
        text += f"({_described(function.args, name)} {_described(function.keywords, name)})"
        function = function.func
    return text


def _described(value: Any, name: str) -> str:
    """Return an argument as a text that differs for another one, and is the same in another process; raises
    `ResultsError` for one without such a text."""
    if isinstance(value, list | tuple):
        return f"{type(value).__name__}({', '.join(_described(each, name) for each in value)})"
    if isinstance(value, dict):
        return f"dict({', '.join(f'{key!r}: {_described(each, name)}' for key, each in value.items())})"
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return f"array({value.dtype.str} {value.shape} {value.tobytes().hex()})"
    if value is None or isinstance(value, bool | int | float | str | bytes | np.generic | Path):
        return repr(value)
    raise ResultsError(
        f"{name} has the argument {value!r:.60}, which no text names; give `source`, a text that names function and"
        " arguments"
    )


def _source_of(function: Callable[..., Any], name: str) -> str:
    """Return the hash of the source of a callable, and of the arguments of a `functools.partial`."""
    arguments, source = _arguments_of(function, name), _file_hash_of(_without_arguments(function), name)
    return text_hash(source + arguments) if arguments else source


def _file_hash_of(function: Callable[..., Any], name: str) -> str:
    """Return the hash of the source of a callable: of its file with what it imports from beside it, or of its text."""
    written = function if inspect.isroutine(function) or isinstance(function, type) else type(function)
    try:
        file = Path(inspect.getsourcefile(written) or "")
        if file.is_file():
            return source_hash(source_files(file.resolve(), file.resolve().parent))
        text = inspect.getsource(written)
    except (OSError, TypeError) as error:
        raise ResultsError(
            f"the source of {name} cannot be read ({error}); give `source`, a text that names it"
        ) from error
    return text_hash(text)
