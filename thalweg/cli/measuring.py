"""Commands that measure: policies, suites of them, and the speed of everything."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from thalweg.cli.options import NO_FILE, River, UsageError, check_file
from thalweg.core.atomic_io import write_atomic


@dataclass(frozen=True)
class Evaluate:
    """Fly a policy from the fixed list of starts of each level and sum up."""

    policy: Positional[str]
    """A run's folder, a policy file, `packaged`, or a baseline: random, hover, forward, pilot."""
    levels: tuple[str, ...] = ()
    """Where to fly; on Easy, Medium and Hard if neither levels nor a file are given."""
    river: River = NO_FILE
    world_seed: int | None = None
    """Of a file's river: its plants and hills."""
    episodes: int = 20
    """Starts per level, each flown once."""
    starts_seed: int = 0
    """Chooses the list of starts."""
    seed: int = 0
    """Of the sampled actions."""
    deterministic: bool = False
    """Take the most probable action instead of a sampled one."""
    unseen: bool = False
    """Fly on other rivers of the levels than the fixed ones, on which nothing is trained: one start on each of so many
    rivers as there are episodes."""
    encoder: Path | None = None
    """The encoder's file; the one that comes with the package if not given."""
    out: Path | None = None
    """Also write one row per episode to this .csv file; one that is there is replaced."""
    device: str = "cpu"
    """Where frames are drawn and encoded: cpu, cuda, cuda:1, or auto, which takes a GPU where there is one that
    works."""

    def run(self) -> int:
        from thalweg.bench.evaluate.evaluation import EvaluationConfig
        from thalweg.cli.printing import Request, evaluate_command

        if self.out is not None:
            check_file("--out", self.out, ".csv")
        reach = self.river.reach("--levels", self.levels)
        if reach is not None and self.unseen:
            raise UsageError("--unseen goes with levels: there is but one river in a file")
        if reach is None and self.world_seed is not None:
            raise UsageError("--world-seed goes with --geojson; the levels are flown on their fixed rivers")
        places = (reach,) if reach is not None else self.levels or ("Easy", "Medium", "Hard")
        config = EvaluationConfig(self.episodes, self.starts_seed, self.deterministic)
        evaluate_command(
            Request(
                self.policy,
                places,
                config,
                self.seed,
                self.world_seed or 0,
                self.encoder,
                self.out,
                self.device,
                self.unseen,
            )
        )
        return 0


@dataclass(frozen=True)
class Bench:
    """Train, evaluate and report a whole suite; the same command resumes."""

    suite: Positional[str]
    """`quick`, `easy`, `open`, `protocols` or `paper`; or a YAML file of your own."""
    out: Path
    """Folder of the results."""
    jobs: int | None = None
    """Runs at a time, each in a process of its own that has its share of the cores; as many as cores if not given. 1:
    one after the other, with progress bars. On a cluster: at most so many."""
    cluster: str | None = None
    """A cluster of Ray's that does the runs: auto, the one that this machine is a node of, or HOST:PORT of its head."""
    cpus: int | None = None
    """Processors that each run takes on a cluster, and threads that it computes in; one if not given."""
    only: tuple[str, ...] = ()
    """Policies (FOCOPS, FOCOPS-paper, hover, packaged), each with all its seeds, or single runs (FOCOPS-0), to be done
    now, such as --only FOCOPS PPO-0; all if none is given. FOCOPS-paper is not among FOCOPS."""

    def run(self) -> int:
        from thalweg.cli.printing import bench_command, executor_for

        return bench_command(self.suite, self.out, self.only, executor_for(self.jobs, self.cluster, self.cpus))


@dataclass(frozen=True)
class Report:
    """Make the report of a results folder again, from its files alone."""

    results: Positional[Path]
    """The folder that `thalweg bench` wrote."""
    out: Path | None = None
    """Where to put it, a new folder or that of an earlier report; `report` within the results if not given."""

    def run(self) -> int:
        from thalweg.bench.report.report import write_report

        report = write_report(self.results, self.out)
        print(f"Report: {report.page}\nTable:  {report.table}")
        for line in report.problems:
            print(f"Note:   {line}")
        return 0


@dataclass(frozen=True)
class Leaderboard:
    """Rank the trained policies of results folders: who meets the limit, then who returns most."""

    results: Positional[tuple[Path, ...]]
    """Folders that `thalweg bench` wrote."""
    out: Path | None = None
    """The page, a .md file, instead of printing it; one that is there is replaced."""

    def run(self) -> int:
        from thalweg.bench.leaderboard import leaderboard

        if self.out is not None:
            check_file("--out", self.out, ".md")
        page = leaderboard(self.results)
        if self.out is None:
            print(page)
        else:
            write_atomic(self.out, page)
            print(f"{self.out}: the leaderboard")
        return 0


@dataclass(frozen=True)
class Speed:
    """Measure the speed of each part on this machine."""

    json: bool = False
    """Print JSON instead of a table."""
    quick: bool = False
    """Fewer repetitions, and no training."""
    stages: bool = False
    """Where the time of a frame goes, instead: milliseconds of each stage on one thread."""
    out: Path | None = None
    """Also write the JSON to this .json file; one that is there is replaced."""

    def run(self) -> int:
        from thalweg.bench.speed.speed_table import speed

        if self.out is not None:
            check_file("--out", self.out, ".json")
        return speed(as_json=self.json, quick=self.quick, out=self.out, stages=self.stages)
