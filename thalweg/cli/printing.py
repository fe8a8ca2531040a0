"""What do `thalweg evaluate` and `thalweg bench` print? The tables, and where everything lies."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES, Policy
from thalweg.bench.evaluate.episodes import Episode, write_episodes
from thalweg.bench.evaluate.evaluation import Course, EvaluationConfig, Label, evaluate, through_encoder
from thalweg.bench.evaluate.progress import all_landed, bar, progress_of_flights
from thalweg.bench.execute.backend import PACKAGED_POLICY
from thalweg.bench.execute.cluster.ray_executor import RayExecutor
from thalweg.bench.execute.executors import Executor, ProcessPoolExecutor, SerialExecutor
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.report.published import SOURCE
from thalweg.bench.report.result_tables import detail_table, paper_table
from thalweg.bench.report.table import is_published
from thalweg.bench.results.results import Results
from thalweg.bench.suite.suites import PACKAGED
from thalweg.bench.suite.yaml_file import suite_of
from thalweg.core.machine import usable_cores
from thalweg.train import load_policy
from thalweg.train.build_notice import announce_build
from thalweg.train.river import check_policy_fits, load_compatible_encoder
from thalweg.world import Reach, level_named

WIDTH = 120
"""Characters in a line of output that no terminal shows."""


@dataclass(frozen=True)
class Request:
    """What `thalweg evaluate` was asked for; fields as in the command."""

    policy: str
    places: tuple[str | Reach, ...]
    """Levels by name, or real rivers."""
    config: EvaluationConfig
    seed: int = 0
    world_seed: int = 0
    """Of the plants and hills of real rivers."""
    encoder: Path | None = None
    out: Path | None = None
    device: str = "cpu"
    """Where frames are drawn and encoded."""
    unseen: bool = False
    """Whether the rivers are others of the levels, one start on each."""


def policy_named(name: str) -> Policy:
    """A baseline, the packaged policy, or that of a folder or file."""
    if name in BASELINES:
        return BASELINES[name]
    path = PACKAGED_POLICY if name == PACKAGED else Path(name)
    if not path.exists():
        known = ", ".join((PACKAGED, *BASELINES))
        raise ResultsError(f"no policy at {path}; give a run's folder, a policy file, or one of: {known}")
    return load_policy(path)


def evaluate_command(request: Request) -> None:
    """Fly, print the tables, and write the rows if asked to."""
    console = _console()
    places = [place if isinstance(place, Reach) else level_named(place).name for place in request.places]
    for place in places:
        if places.count(place) > 1:
            raise ResultsError(f"--levels names {place} twice; each level is flown once")
    policy = policy_named(request.policy)
    encoder = None if hasattr(policy, "sees") else load_compatible_encoder(request.encoder, request.device)
    if encoder is not None:
        check_policy_fits(policy, encoder)
    name = request.policy if request.policy in (*BASELINES, PACKAGED) else Path(request.policy).resolve().name
    rows: list[Episode] = []
    for place in places:
        courses, level = _courses(place, request)
        with bar(console, "episodes") as progress:
            for course in courses:
                look = through_encoder(course.world, encoder) if encoder is not None else None
                river = f", river {course.world.seed}" if request.unseen else ""
                on_step = progress_of_flights(progress, f"{name} on {level}{river}", len(course.starts))
                label = Label(name, request.seed, level)
                rows.extend(evaluate(policy, course, label, request.config, look=look, on_step=on_step))
                all_landed(progress)
    if request.out is not None:
        write_episodes(request.out, rows)
    print_tables(console, Results(Path(), {}, [], rows, [], []))
    if request.out is not None:
        console.print(f"One row per episode: {request.out}", highlight=False)


def _courses(place: str | Reach, request: Request) -> tuple[list[Course], str]:
    """The courses of a level or a real river, and what their rows are called."""
    if isinstance(place, str) and request.unseen:
        return Course.unseen(place, request.config), place
    if isinstance(place, str):
        return [Course.of_level(place, request.config)], place
    announce_build(place, request.world_seed)
    return [Course.on(place.build(request.world_seed), request.config)], place.name


def bench_command(name: str, folder: Path, only: tuple[str, ...], executor: Executor) -> int:
    """Run a suite, or some of it; returns 1 if one of its runs failed."""
    console = _console()
    outcome = run_suite(suite_of(name), folder, console=console, executor=executor, only=only)
    print_tables(console, outcome.results, detail=False)
    lines = [f"Report: {outcome.report.page}", f"Table:  {outcome.report.table}"]
    if outcome.report.film is not None:
        lines.append(f"Film:   {outcome.report.film}")
    lines.extend(f"Failed: {row.run}: {row.error}" for row in outcome.failed)
    console.print("\n".join(lines), highlight=False, soft_wrap=True, markup=False)
    return 1 if outcome.failed else 0


def executor_for(jobs: int | None, cluster: str | None, cpus: int | None) -> Executor:
    """Who does the runs, as the command's options say; raises `ResultsError` where they do not go together."""
    if cluster is not None:
        return RayExecutor(cluster, jobs, 1 if cpus is None else cpus)
    if cpus is not None:
        raise ResultsError("--cpus goes with --cluster; here, runs share the cores")
    jobs = usable_cores() if jobs is None else jobs
    return SerialExecutor() if jobs == 1 else ProcessPoolExecutor(jobs)


def _console() -> Console:
    """The terminal; a pipe has no width of its own, and a wrapped number is hard to read."""
    return Console() if Console().is_terminal else Console(width=WIDTH)


def print_tables(console: Console, results: Results, *, detail: bool = True) -> None:
    """The paper's table, and with `detail` what it leaves out."""
    texts = [paper_table(results).text] + ([detail_table(results).text] if detail else [])
    for text in texts:
        table = Table(*(Column(name, justify="right" if index else "left") for index, name in enumerate(text.columns)))
        for row in text.itertuples(index=False, name=None):
            published = is_published(row[0])
            table.add_row("published *" if published else row[0], *row[1:], style="dim" if published else None)
        console.print(table)
    if any(map(is_published, texts[0].iloc[:, 0])):
        console.print(f"* {SOURCE}: measured in another simulator, on other rivers", highlight=False)
