"""Which flights do the films show? The best of all; and of each trained policy its best and its typical failure.

A film is made again only when it would show another flight, or another figure in its caption.
"""

import errno
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import REASONS, WORDS, Episode, read_episodes
from thalweg.bench.evaluate.progress import bar, progress_of_frames
from thalweg.bench.execute.rivers import Place
from thalweg.bench.pictures.film_format import LARGE, SMALL
from thalweg.bench.results.results import FILMS, KINDS, MAIN_FILM, FilmFiles, evaluation_path
from thalweg.bench.results.statistics import mean_and_std_text, summarise
from thalweg.bench.suite.suites import Run, Suite
from thalweg.core.atomic_io import write_atomic

BEST, FAILURE = KINDS
WHOSE = {"packaged": "the packaged policy", "train": "trained policies", "baseline": "baselines"}


@dataclass(frozen=True)
class Shot:
    """A flight to be filmed."""

    name: str
    """Of its files, within the results."""
    run: Run
    episode: Episode
    why: str
    """What this flight is among those that it was chosen from."""

    def caption(self, title: str) -> str:
        """What the film shows of the policy called so, and why."""
        row = self.episode
        return (
            f"{title} on {row.level}, start {row.episode} of the list: {row.length} steps, return {row.return_:.2f}, "
            f"cost {row.cost:.1f}, {WORDS[row.reason]}. {self.why}\n"
        )


def film_flights(suite: Suite, folder: Path, place: Place, console: Console) -> None:
    """Make the films that are not there yet, and remove those of flights that are no longer to be shown.

    What goes wrong is said in the report; a full disk stops all.
    """
    shots = [shot for shot in (best_of_all(suite, folder), *shots_of_each(suite, folder)) if shot is not None]
    wanted = {path for shot in shots for path in FilmFiles.of(folder, shot.name).paths}
    names = [f"{FILMS}/{arm.label}-{kind}" for arm in suite.arms for kind in KINDS]
    for path in {path for name in names for path in FilmFiles.of(folder, name).paths} - wanted:
        path.unlink(missing_ok=True)
    for shot in shots:
        _film(shot, folder, place, console)


def _film(shot: Shot, folder: Path, place: Place, console: Console) -> None:
    """Film a flight, unless its film is there."""
    shape = LARGE if shot.name == MAIN_FILM else SMALL
    files, home = FilmFiles.of(folder, shot.name), folder / "runs" / shot.run.name
    try:
        caption = shot.caption(place.title(shot.run, home))
        if files.film.exists() and files.caption.exists() and files.caption.read_text(encoding="utf-8") == caption:
            return
        files.film.parent.mkdir(exist_ok=True)
        files.caption.unlink(missing_ok=True)
        with bar(console, "frames") as progress:
            on_frame = progress_of_frames(progress, files.film.stem, len(shape.shown_steps(shot.episode.length)))
            place.film(shot.run, home, shot.episode, files.film, on_frame, shape=shape)
        write_atomic(files.caption, caption)
        files.failure.unlink(missing_ok=True)
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            raise
        files.film.unlink(missing_ok=True)
        write_atomic(files.failure, " ".join(f"{type(error).__name__}: {error}".split()) + "\n")
        console.print(f"No film {shot.name}: {error}", style="red", highlight=False, markup=False)


def best_of_all(suite: Suite, folder: Path) -> Shot | None:
    """The best flight of the packaged policy where there is one, else of a trained one, on the level of training."""
    level = suite.train_level if suite.train_level in suite.test_levels else suite.test_levels[0]
    for kind in ("packaged", "train", "baseline"):
        flights = _flights([run for run in suite.runs() if run.kind == kind], level, folder)
        if flights:
            run, episode = _best(flights)
            own = summarise([other for _, other in flights if other.algorithm == episode.algorithm])
            return Shot(
                MAIN_FILM,
                run,
                episode,
                f"The best of {len(flights)} flights of {WHOSE[kind]} there; the return of {episode.algorithm}'s "
                f"{own.episodes} is {mean_and_std_text(own.return_mean, own.return_std)}.",
            )
    return None


def shots_of_each(suite: Suite, folder: Path) -> list[Shot]:
    """Of each trained policy that has flown where it was trained: its best flight and its typical failure, the one of
    middle return among those that ended for its most frequent reason of failure."""
    shots = []
    for arm in suite.arms:
        runs = [run for run in suite.runs() if run.algorithm == arm.label]
        flights = _flights(runs, suite.level_of(arm), folder)
        if not flights:
            continue
        count, failed = len(flights), [flight for flight in flights if not flight[1].success]
        said = f"{arm.label}'s {count} flights there"
        best = f"The best of {said}, of which {count - len(failed)} succeeded."
        shots.append(Shot(f"{FILMS}/{arm.label}-{BEST}", *_best(flights), best))
        if failed:
            reason, times = _most_frequent([episode for _, episode in failed])
            alike = [flight for flight in failed if flight[1].reason == reason]
            middle = sorted(alike, key=lambda flight: flight[1].return_)[(len(alike) - 1) // 2]
            place = ", whose return is in their middle" if times > 2 else ""
            why = f"{len(failed)} of {said} failed, {times} of them like this one{place}."
            shots.append(Shot(f"{FILMS}/{arm.label}-{FAILURE}", *middle, why))
    return shots


def _flights(runs: list[Run], level: str, folder: Path) -> list[tuple[Run, Episode]]:
    """All flights of some runs on a level; files that can't be used are left out, which the report says of them."""
    found = []
    for run in runs:
        with suppress(ResultsError, OSError):
            rows = read_episodes(evaluation_path(folder, run.name, Trial(level)))
            found.extend((run, episode) for episode in rows)
    return found


def _best(flights: list[tuple[Run, Episode]]) -> tuple[Run, Episode]:
    """The one with the greatest return, then the least cost."""
    return max(flights, key=lambda flight: (flight[1].return_, -flight[1].cost, -flight[1].episode))


def _most_frequent(failed: list[Episode]) -> tuple[str, int]:
    """For which reason most of them ended, and how many."""
    counts = Counter(episode.reason for episode in failed)
    reason = max(REASONS, key=lambda reason: counts[reason])
    return reason, counts[reason]
