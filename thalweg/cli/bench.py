"""`thalweg bench`: training, evaluation and report of a suite."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from thalweg.cli.command import Command
from thalweg.cli.forces import STILL, ForceFlags, Forces
from thalweg.cli.options import NO_FILE, Plugins, Policies, River, RiverFile, UsageError, checked_task
from thalweg.cli.views import AS_IN_LEVELS, TrainedViews, Views

if TYPE_CHECKING:
    from thalweg.bench.execute.executors import Executor
    from thalweg.bench.execute.verification import Verification
    from thalweg.bench.suite.config import Suite
    from thalweg.world import Reach


SUITE = (
    "quick, easy, open, protocols, paper, geometry, imitated, privileged, swimmers, nests, racingline, portage,"
    " swimmers-frames, nests-frames, racingline-frames, portage-frames, or your own YAML file."
)
"""What the argument of the command may be."""


@dataclass(frozen=True)
class Bench(Command):
    """Train, evaluate and report a suite of runs; the same command resumes."""

    suite: Positional[Annotated[str, arg(help=SUITE)]]
    out: Path | None = None
    """Folder of the results. It must be given, but for --verify, which makes runs again in NAME-verified by default."""
    jobs: int | None = None
    """Runs at a time, each a process with its share of the cores; one per core by default. 1 shows progress bars."""
    cluster: str | None = None
    """Run on a Ray cluster, at most --jobs runs at a time: auto for this machine's, or HOST:PORT of its head."""
    cpus: int | None = None
    """Processors and threads of each run on a cluster; by default 1."""
    task: str | None = None
    """River, Swimmers, Nests, RacingLine or Portage; by default that of the suite."""
    hard: Annotated[bool, FlagCreatePairsOff] = False
    """End an episode at the first cost of the task, also where the suite does not."""
    forces: Forces = STILL
    views: Views = AS_IN_LEVELS
    river: River = NO_FILE
    only: tuple[str, ...] = ()
    """Policies (FOCOPS, hover), with all their seeds, or runs (PPO-0), such as --only FOCOPS PPO-0; all by default."""
    reuse: Path | None = None
    """Folder of another suite's results: trainings that are finished and the same there are copied, and only flown."""
    verify: Path | None = None
    """Folder of the suite's results: the runs of --only are made again and compared with it; status 1: they differ."""
    policy: Policies = ()
    """Flown without training: a function (fly.py:fly), a run's folder, a policy file or packaged-rgb; repeatable."""
    plugin: Plugins = ()

    resumes = True

    def run(self) -> int:
        asked = RequestedRuns(
            suite=self.suite,
            only=self.only,
            executor=executor_for(self.jobs, self.cluster, self.cpus),
            river=self.river,
            rules=Rules(self.task, self.hard, self.forces, self.views),
            policies=self.policy,
        )
        if self.verify is not None:
            if not self.only:
                raise UsageError("--verify makes runs again: name them by --only, such as --only FOCOPS-0")
            if self.reuse is not None:
                raise UsageError("--verify makes runs again, so that --reuse does not go with it")
            repeated = self.out or Path(f"{self.verify.resolve().name}-verified")
            return verify_and_print(asked, self.verify, repeated)
        if self.out is None:
            raise UsageError("give the folder of the results, such as --out results/quick")
        return run_and_print(asked, self.out, self.reuse)


@dataclass(frozen=True)
class Rules:
    """What replaces the rules of a suite."""

    task: str | None = None
    hard: bool = False
    forces: ForceFlags = STILL
    views: TrainedViews = AS_IN_LEVELS

    def of(self, suite: "Suite") -> "Suite":
        """Return the suite with these rules where they are given; raises the errors of suites."""
        task = suite.task if self.task is None else checked_task(self.task)
        forces, views = self.forces.options(suite.forces), self.views.replacing(suite.views)
        return replace(suite, task=task, hard=self.hard or suite.hard, forces=forces, views=views)


@dataclass(frozen=True)
class RequestedRuns:
    """Runs of a suite that a command line asks for."""

    suite: str
    """Name or file of the suite."""
    only: tuple[str, ...]
    """Policies or runs; all if there are none."""
    executor: "Executor"
    river: RiverFile
    """All policies also fly on the river of this file, if it is one, as a condition of its own."""
    rules: Rules
    """Replace those of the suite."""
    policies: tuple[str, ...]
    """Functions and policies that are flown too."""

    def resolved(self) -> "Suite":
        """Return the suite with the rules, the policies and the river; raises the errors of each."""
        from thalweg.bench.suite.builtin import load_suite
        from thalweg.bench.suite.flown import flown

        suite = self.rules.of(load_suite(self.suite))
        suite = replace(suite, policies=(*suite.policies, *map(flown, self.policies)))
        reach = self.river.reach("a suite", None)
        return suite if reach is None else with_river(suite, reach)


def run_and_print(asked: RequestedRuns, folder: Path, reuse: Path | None = None) -> int:
    """Run a suite, or a part of it, in a folder, and print its tables; returns 1 if a run failed. Trainings are taken
    from the results in `reuse` where they are the same."""
    from thalweg.bench.execute.runner import run_suite
    from thalweg.cli.tables import make_console, print_tables

    console = make_console()
    suite, only, executor = asked.resolved(), asked.only, asked.executor
    outcome = run_suite(suite, folder, console=console, executor=executor, only=only, reuse=reuse)
    print_tables(console, outcome.results, detail=False)
    lines = [f"Report: {outcome.report.page}", f"Table:  {outcome.report.table}"]
    if outcome.report.film is not None:
        lines.append(f"Film:   {outcome.report.film}")
    lines.extend(f"Failed: {row.run}: {row.error}" for row in outcome.failed)
    console.print("\n".join(lines), highlight=False, soft_wrap=True, markup=False)
    return 1 if outcome.failed else 0


def verify_and_print(asked: RequestedRuns, recorded: Path, repeated: Path) -> int:
    """Make runs of a suite again in the folder `repeated`, compare them with those in `recorded`, and print what
    agrees; returns 1 if something does not."""
    from thalweg.bench.execute.verification import verify
    from thalweg.cli.tables import make_console

    console = make_console()
    suite, only, executor = asked.resolved(), asked.only, asked.executor
    outcomes = verify(suite, recorded, repeated, only, console=console, executor=executor)
    lines = [line for outcome in outcomes for line in verification_lines(outcome, recorded, repeated)]
    console.print("\n".join(lines), highlight=False, soft_wrap=True, markup=False)
    return 0 if all(outcome.reproduced for outcome in outcomes) else 1


def verification_lines(outcome: "Verification", recorded: Path, repeated: Path) -> list[str]:
    """Return what is said of a run that was made again: how it was compared, each part, and the verdict."""
    lines = [f"{outcome.run} of {recorded}, made again in {repeated}"]
    if outcome.conditions:
        lines.append(f"  made under other conditions ({'; '.join(outcome.conditions)}): means within the tolerances")
    else:
        lines.append("  on the same kind of processor, with the same packages: compared to the bit")
    for part in outcome.parts:
        agrees = part.means or "the same to the bit"
        lines.append(f"  {part.name}, {part.episodes} episodes: {'; '.join(part.differences) or agrees}")
    lines.append(f"{outcome.run}: {'reproduced' if outcome.reproduced else 'NOT reproduced'}")
    return lines


def with_river(suite: "Suite", reach: "Reach") -> "Suite":
    """Return a suite whose policies also fly on the river of a file, under the condition `river`.

    Raises the errors of the file, and `ResultsError` for a suite that has a condition of that name.
    """
    from thalweg.bench.evaluate.conditions import Condition

    reach.check()
    name = "-".join(re.findall(r"\w+", reach.path.stem)) or "river"
    own = {"file": str(reach.path), **reach.reach_data()}
    condition = Condition("river", rivers=(name,), files={name: own})
    return replace(suite, conditions=(*suite.conditions, condition))


def executor_for(jobs: int | None, cluster: str | None, cpus: int | None) -> "Executor":
    """Return the executor for the options of the command; raises `ResultsError` for options that do not go together."""
    from thalweg.bench.csv_files import ResultsError
    from thalweg.bench.execute.cluster.ray_executor import RayExecutor
    from thalweg.bench.execute.executors import ProcessPoolExecutor, SerialExecutor
    from thalweg.core.cores import usable_cores

    if cluster is not None:
        return RayExecutor(cluster, jobs, 1 if cpus is None else cpus)
    if cpus is not None:
        raise ResultsError("--cpus goes with --cluster; here, runs share the cores")
    jobs = usable_cores() if jobs is None else jobs
    return SerialExecutor() if jobs == 1 else ProcessPoolExecutor(jobs)
