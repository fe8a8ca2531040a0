"""Films of flights: the main one, and for each trained policy its best and its typical failure.

A film is made again only if it would show another flight, or if its caption would change. Flights with outdated
versions are not filmed; films of them stay until there are others.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from thalweg.bench.evaluate.episodes import ALL_REASONS, Episode
from thalweg.bench.evaluate.progress import progress_bar, track_frames
from thalweg.bench.execute.backend import Backend
from thalweg.bench.pictures.film_format import LARGE, SMALL
from thalweg.bench.results.results import FILMS, KINDS, MAIN_FILM, FilmFiles, Results, flight_in_words
from thalweg.bench.results.statistics import mean_and_std_text, summarise
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.core.atomic_io import is_disk_error, write_atomic

BEST, FAILURE = KINDS
WHOSE = {
    "packaged": "the packaged policy",
    "train": "trained policies",
    "policy": "policies trained before",
    "function": "functions",
    "baseline": "baselines",
}


@dataclass(frozen=True)
class Shot:
    """A flight to be filmed."""

    name: str
    """Name of its files in the results folder."""
    run: Run
    episode: Episode
    why: str
    """What distinguishes this flight from those that it was chosen from."""

    def caption(self, title: str) -> str:
        """Return the caption of the film, for a policy with this title."""
        return f"{title}{flight_in_words(self.episode)} {self.why}\n"


def film_flights(suite: Suite, results: Results, backend: Backend, console: Console) -> None:
    """Make the missing films, and remove those of flights that are no longer to be shown; a suite may want none.

    An error is named in the report; only a full disk is raised (`OSError`).
    """
    if suite.film == "none":
        return
    shots = [shot for shot in (best_of_all(suite, results), *policy_shots(suite, results)) if shot is not None]
    wanted = {path for shot in shots for path in FilmFiles.of(results.folder, shot.name).paths}
    flown = {episode.algorithm for episode in results.episodes}
    outdated = {policy.policy for policy in results.outdated.values()} - flown
    names = [f"{FILMS}/{arm.label}-{kind}" for arm in suite.arms for kind in KINDS if arm.label not in outdated]
    for path in {path for name in names for path in FilmFiles.of(results.folder, name).paths} - wanted:
        path.unlink(missing_ok=True)
    for shot in shots:
        _film(shot, results.folder, backend, console)


def _film(shot: Shot, folder: Path, backend: Backend, console: Console) -> None:
    """Film a flight, unless its film exists."""
    shape = LARGE if shot.name == MAIN_FILM else SMALL
    files, run_folder = FilmFiles.of(folder, shot.name), folder / "runs" / shot.run.name
    try:
        caption = shot.caption(backend.title(shot.run, run_folder))
        if files.film.exists() and files.caption.exists() and files.caption.read_text(encoding="utf-8") == caption:
            return
        files.film.parent.mkdir(exist_ok=True)
        files.caption.unlink(missing_ok=True)
        with progress_bar(console, "frames") as progress:
            on_frame = track_frames(progress, files.film.stem, len(shape.shown_steps(shot.episode.length)))
            backend.film(shot.run, run_folder, shot.episode, files.film, on_frame, shape=shape)
        write_atomic(files.caption, caption)
        files.failure.unlink(missing_ok=True)
    except Exception as error:
        if is_disk_error(error):
            raise
        files.film.unlink(missing_ok=True)
        files.poster.unlink(missing_ok=True)
        write_atomic(files.failure, " ".join(f"{type(error).__name__}: {error}".split()) + "\n")
        console.print(f"No film {shot.name}: {error}", style="red", highlight=False, markup=False)


def best_of_all(suite: Suite, results: Results) -> Shot | None:
    """Return the best flight on the training level of the packaged policy, else of a trained one, else a baseline.

    If the suite films the `best`, trained policies come first.
    """
    level = suite.train_level if suite.train_level in suite.test_levels else suite.test_levels[0]
    first = ("train", "packaged") if suite.film == "best" else ("packaged", "train")
    for kind in (*first, "policy", "function", "baseline"):
        flights = _flights([run for run in suite.runs() if run.kind == kind], level, results)
        if flights:
            run, episode = _best(flights)
            summary = summarise([other for _, other in flights if other.algorithm == episode.algorithm])
            name = WHOSE[kind] if kind == "packaged" else episode.algorithm
            return Shot(
                MAIN_FILM,
                run,
                episode,
                f"The best of {len(flights)} flights of {WHOSE[kind]} there. The {summary.episodes} flights of {name}"
                f" have a mean return of {mean_and_std_text(summary.return_mean, summary.return_std)}.",
            )
    return None


def policy_shots(suite: Suite, results: Results) -> list[Shot]:
    """Return the best flight and the typical failure of each trained policy that flew on its training level.

    The typical failure has the median return among the flights that ended for the most frequent reason of failure.
    """
    shots = []
    for arm in suite.arms:
        runs = [run for run in suite.runs() if run.algorithm == arm.label]
        flights = _flights(runs, suite.level_of(arm), results)
        if not flights:
            continue
        count, failed = len(flights), [flight for flight in flights if not flight[1].success]
        flights_text = f"{arm.label}'s {count} flights there"
        best = f"The best of {flights_text}, of which {count - len(failed)} succeeded."
        shots.append(Shot(f"{FILMS}/{arm.label}-{BEST}", *_best(flights), best))
        if failed:
            reason, times = _most_frequent([episode for _, episode in failed])
            alike = [flight for flight in failed if flight[1].reason == reason]
            middle = sorted(alike, key=lambda flight: flight[1].return_)[(len(alike) - 1) // 2]
            middle_of = ", whose return is in their middle" if times > 2 else ""
            why = f"{len(failed)} of {flights_text} failed, {times} of them like this one{middle_of}."
            shots.append(Shot(f"{FILMS}/{arm.label}-{FAILURE}", *middle, why))
    return shots


def _flights(runs: list[Run], level: str, results: Results) -> list[tuple[Run, Episode]]:
    """Return all flights of some runs on a level, with current versions."""
    return [
        (run, episode)
        for run in runs
        for episode in results.episodes
        if (episode.algorithm, episode.seed, episode.level) == (run.algorithm, run.seed, level)
    ]


def _best(flights: list[tuple[Run, Episode]]) -> tuple[Run, Episode]:
    """Return the flight with the greatest return; of equal ones, that with the least cost."""
    return max(flights, key=lambda flight: (flight[1].return_, -flight[1].cost, -flight[1].episode))


def _most_frequent(failed: list[Episode]) -> tuple[str, int]:
    """Return the most frequent reason for the ends of flights, and its number of occurrences."""
    counts = Counter(episode.reason for episode in failed)
    reason = max(ALL_REASONS, key=lambda reason: counts[reason])
    return reason, counts[reason]
