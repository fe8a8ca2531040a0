"""Columns of the leaderboard that describe a policy, whatever its task."""

from dataclasses import dataclass
from typing import Any

from thalweg.bench.leaderboard.requirements import Flights, missing_of_arm, missing_of_flown
from thalweg.bench.packaged import PACKAGED, PACKAGED_SEES
from thalweg.bench.results.results import Results
from thalweg.bench.suite.record import begins_with_teacher, encoder_of, observation_of, training_steps
from thalweg.train.observations import FRAMES, PRIVILEGED


@dataclass(frozen=True, kw_only=True)
class PolicyEntry:
    """A policy of a results folder."""

    policy: str
    source: str
    """Name of the results folder."""
    versions: str
    """The versions that the results were made with: `current`, or those that differ."""
    steps: int
    """Training steps of each seed."""
    seeds: int
    """Number of seeds whose runs finished."""
    missing: tuple[str, ...]
    """What the results lack of the requirements of its task."""
    critics_see: str = "none"
    """What its critics saw in training, see `Results.critics_see`."""
    observation: str = FRAMES
    """What the policy sees, see `thalweg.train.observations.IN_WORDS`."""
    encoder: str = "default"
    """Name of the packaged encoder of its frames, if it sees their codes."""
    made_by: str = ""
    """Version and source of the plug-ins that it was trained by, or of the function that it is."""
    trained: bool = True
    """Whether it was trained here; functions, the packaged policy and others of files were not."""
    taught: bool = False
    """Whether it learnt from a teacher that knows the map, or began with a policy that did, as the packaged one."""

    @property
    def privileged(self) -> bool:
        """Whether the policy sees the privileged observation instead of frames."""
        return self.observation == PRIVILEGED

    @property
    def policy_and_sight(self) -> str:
        """The policy, with what it sees in brackets unless that is the codes of the default encoder."""
        seen = self.encoder if self.observation == FRAMES else self.observation
        return self.policy if seen == "default" else f"{self.policy} ({seen})"

    @property
    def versions_and_makers(self) -> str:
        """The versions, with the plug-ins or the function if there are any."""
        return f"{self.versions}; {self.made_by}" if self.made_by else self.versions


def versions_of(results: Results, name: str) -> str:
    """Return the `versions` of the policy under whose name episodes stand in results."""
    outdated = results.outdated.get(name)
    return "current" if outdated is None else outdated.versions


def finished_seeds(results: Results, name: str) -> int:
    """Return the number of runs that finished of the policy under whose name episodes stand in results."""
    return sum(row.algorithm == name and row.status == "finished" for row in results.runs)


def arm_fields(results: Results, name: str, arm: dict[str, Any], usual: Flights, unseen: Flights) -> dict[str, Any]:
    """Return the fields of `PolicyEntry` of an arm with its flights on each level, on the usual and on unseen rivers.

    `name` is that of its episodes: the arm's, or that of its outdated runs.
    """
    outdated = name in results.outdated
    return {
        "policy": arm["name"],
        "source": results.folder.resolve().name,
        "versions": versions_of(results, name),
        "steps": training_steps(arm),
        "seeds": finished_seeds(results, name),
        "missing": ("current versions",) if outdated else tuple(missing_of_arm(results, arm, usual, unseen)),
        "critics_see": results.critics_see(name),
        "observation": observation_of(results.suite, arm),
        "encoder": encoder_of(results.suite, arm),
        "made_by": results.made_by(name),
        "taught": begins_with_teacher(arm),
    }


def flown_policies(results: Results) -> list[dict[str, Any]]:
    """Return the records of the policies of a suite that were not trained in its results: the packaged one if it is
    flown, functions, and others of files."""
    packaged = {"name": PACKAGED, "observation": PACKAGED_SEES, "taught": True}
    return [*([packaged] if results.suite.get("packaged") else []), *results.suite.get("policies", [])]


def flown_fields(
    results: Results, name: str, policy: dict[str, Any], usual: Flights, unseen: Flights
) -> dict[str, Any]:
    """Return the fields of `PolicyEntry` of one of the `flown_policies` with its flights, as `arm_fields` does; each of
    its seeds, which a policy of several files alone has, was flown once from every start."""
    return {
        "policy": policy["name"],
        "source": results.folder.resolve().name,
        "versions": versions_of(results, name),
        "steps": 0,
        "seeds": finished_seeds(results, name),
        "missing": ("current versions",)
        if name in results.outdated
        else tuple(missing_of_flown(results, policy, usual, unseen)),
        "observation": policy["observation"],
        "encoder": encoder_of(results.suite, policy),
        "made_by": results.made_by(name),
        "trained": False,
        "taught": bool(policy.get("taught")),
    }
