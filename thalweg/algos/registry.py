"""The registry of algorithms: one dictionary of those that come with the package, and the plug-ins beside them.

Everything that runs, lists or documents algorithms reads it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, ClassVar

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.interface import Learner, Task
from thalweg.algos.offpolicy.ddpglag import DDPGLag, DDPGLagConfig
from thalweg.algos.offpolicy.saclag import SACLag, SACLagConfig
from thalweg.algos.offpolicy.td3lag import TD3Lag, TD3LagConfig
from thalweg.algos.onpolicy.cpo import CPO, CPOConfig
from thalweg.algos.onpolicy.cup import CUP, CUPConfig
from thalweg.algos.onpolicy.focops import FOCOPS, FOCOPSConfig
from thalweg.algos.onpolicy.oncrpo import OnCRPO, OnCRPOConfig
from thalweg.algos.onpolicy.p3o import P3O, P3OConfig
from thalweg.algos.onpolicy.ppo import PPO, PPOConfig
from thalweg.algos.onpolicy.ppolag import PPOLag, PPOLagConfig
from thalweg.algos.planning.ccepets import CCEPETS, CCEPETSConfig
from thalweg.algos.planning.safeloop import SafeLOOP, SafeLOOPConfig
from thalweg.algos.presets import settings_for_envs, settings_for_images, settings_of
from thalweg.core import versions
from thalweg.core.config import parse_config, refuse_unknown
from thalweg.core.plugins import lookup
from thalweg.core.plugins.record import Plugin, PluginError, check_record
from thalweg.core.suggestion import did_you_mean

WIDE = 2
"""PyTorch threads of off-policy algorithms and planners, whose networks are wide in the study's preset; more were not
measured."""


@dataclass(frozen=True)
class Entry:
    """An algorithm by its name in the paper."""

    name: str
    config: type
    """A frozen dataclass; each field's docstring is its help text."""
    make: Callable[[Any, Task], Learner]
    about: str
    """Description in one line."""
    threads: int = 1
    """PyTorch threads on the CPU: a second one slows small networks down and speeds wide ones up."""

    def configure(self, given: Any = None, preset: str = "default", num_envs: int = 1) -> Any:
        """Return the config of a preset with the given values on top; a complete config is returned unchanged.

        Values that are not given may depend on the number of environments (`settings_for_envs`), but not in the study's
        preset, and on whether the policy sees images (`settings_for_images`).

        Raises `AlgorithmError` for an unknown preset or key, listing the known ones, for a value of the wrong type, and
        for a preset beside a whole config.
        """
        base = settings_of(self.name, preset)
        if given is None or isinstance(given, Mapping):
            names = [name for name in given or () if isinstance(name, str)]  # `parse_config` refuses others
            known = [field.name for field in fields(self.config)]
            if "policy" in names and "policy" not in known:
                raise AlgorithmError(f"policy is a setting of on-policy algorithms; {self.name} sees numbers only")
            refuse_unknown(f"setting of {self.name}", names, known, AlgorithmError)
            followed = settings_for_envs(self.config, num_envs) if preset == "default" else {}
            followed |= settings_for_images(self.config, given or {})
            return parse_config(self.config, {**followed, **base, **(given or {})})
        if preset != "default":
            raise AlgorithmError(
                f"a whole {self.config.__name__} leaves nothing to the preset {preset!r}: give one of them"
            )
        return parse_config(self.config, given)


ALGORITHMS: dict[str, Entry] = {
    entry.name: entry
    for entry in (
        Entry("PPO", PPOConfig, PPO, "clipped policy gradient on the reward alone"),
        Entry("PPOLag", PPOLagConfig, PPOLag, "PPO on reward less a multiplier times cost"),
        Entry(
            "FOCOPS", FOCOPSConfig, FOCOPS, "first-order constrained optimisation within a trust region of each state"
        ),
        Entry("P3O", P3OConfig, P3O, "PPO with an exact penalty that only a broken limit switches on"),
        Entry("OnCRPO", OnCRPOConfig, OnCRPO, "natural steps for the reward, or against a cost above its limit"),
        Entry("CPO", CPOConfig, CPO, "the best natural step that keeps the limit to first order"),
        Entry("CUP", CUPConfig, CUP, "PPO on the reward, then a projection towards the limit"),
        Entry("DDPGLag", DDPGLagConfig, DDPGLag, "deterministic policy gradient from a replay, with multipliers", WIDE),
        Entry("TD3Lag", TD3LagConfig, TD3Lag, "DDPGLag with twin critics, smoothed targets and a delayed policy", WIDE),
        Entry("SACLag", SACLagConfig, SACLag, "maximum-entropy policy from a replay, with multipliers", WIDE),
        Entry(
            "CCEPETS",
            CCEPETSConfig,
            CCEPETS,
            "plans by constrained cross-entropy in an ensemble of learnt models",
            WIDE,
        ),
        Entry(
            "SafeLOOP",
            SafeLOOPConfig,
            SafeLOOP,
            "plans like CCEPETS, with an actor that proposes and critics beyond",
            WIDE,
        ),
    )
}


GROUP = "thalweg.algorithms"
"""Group of the entry points of algorithms."""
NEEDED = ("frame_stack", "rollout_steps")
"""What a run asks of every config: a number of observations seen side by side, and the method that returns T."""


@dataclass(frozen=True)
class AlgorithmPlugin(Entry):
    """An algorithm from outside the package; docs/extend.md has an example.

    Raises `PluginError` for a name that is taken, a version below 1, and a config that a run cannot use.
    """

    version: int = 0
    """Version of its updates, 1 or more; to be raised when they change. Results bear it beside a hash of the source."""
    plugin_group: ClassVar[str] = GROUP

    def __post_init__(self) -> None:
        check_record(GROUP, self.name, self.version, ALGORITHMS)
        kind: Any = self.config
        if not (isinstance(kind, type) and is_dataclass(kind) and hasattr(kind, "__config_error__")):
            raise PluginError(
                f"the config of {self.name} is {kind!r}; it must be a class under @frozen_config(AlgorithmError), such"
                " as one derived from thalweg.algos.onpolicy.config.FirstOrderConfig"
            )
        if missing := [name for name in NEEDED if not hasattr(kind, name)]:
            raise PluginError(
                f"{kind.__name__}, the config of {self.name}, lacks {' and '.join(missing)}; a run needs the field"
                " frame_stack: int = 1 and the method rollout_steps(num_envs) -> int"
            )
        try:
            kind()
        except Exception as error:
            raise PluginError(
                f"{kind.__name__}() fails ({error}); give every setting of {self.name} a default"
            ) from error
        if not callable(self.make):
            raise PluginError(f"make of {self.name} is {self.make!r}; it must be called as make(config, task)")


def algorithm_named(name: str) -> Entry:
    """Return the algorithm of that name, ignoring case, from the package or a plug-in.

    Raises `AlgorithmError`, which lists the known ones, for an unknown name, and `PluginError` for a plug-in that
    cannot be used.
    """
    plugin = plugin_named(name)
    if plugin is not None:
        return plugin.record
    for known, entry in ALGORITHMS.items():
        if known.lower() == name.lower():
            return entry
    known = algorithm_names()
    raise AlgorithmError(f"there is no algorithm {name!r}{did_you_mean(name, known)}; there are {', '.join(known)}")


def plugin_named(name: str) -> Plugin | None:
    """Return the plug-in of the algorithm with that name, ignoring case; None if there is no such plug-in."""
    return lookup.find(GROUP, name, ALGORITHMS)


def algorithm_names() -> list[str]:
    """Return the names of all algorithms, those of plug-ins last."""
    return [*ALGORITHMS, *(name for name in lookup.names(GROUP) if name not in ALGORITHMS)]


def installed_algorithm(name: str) -> Entry | None:
    """Return the algorithm with exactly that name; None for one that is not here, or is a plug-in that cannot be used.

    For results, which can be read without the algorithms that they are of.
    """
    try:
        plugin = plugin_named(name)
    except PluginError:
        return ALGORITHMS.get(name)
    return ALGORITHMS.get(name) if plugin is None or plugin.name != name else plugin.record


def version_of(name: str) -> int | None:
    """Return the version of the algorithm with exactly that name; None for one that is not here."""
    entry = installed_algorithm(name)
    return entry.version if isinstance(entry, AlgorithmPlugin) else versions.ALGORITHMS.get(name)
