"""Which flight does the film show? The best one, and it says so.

A film is made again only when it would show another flight, or another figure in its caption.
"""

import errno
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from thalweg.bench.bars import bar, progress_of_frames
from thalweg.bench.conditions import Trial
from thalweg.bench.episodes import WORDS, Episode, read_episodes
from thalweg.bench.results import CAPTION, FILM, NO_FILM, evaluation_path
from thalweg.bench.river import Place
from thalweg.bench.statistics import summarise
from thalweg.bench.suites import Run, Suite
from thalweg.bench.tables import plus_minus
from thalweg.whole import write_whole


@dataclass(frozen=True)
class Best:
    """The flight to be filmed."""

    run: Run
    episode: Episode
    among: list[Episode]
    """All flights that it was chosen from: those of its kind of policy on its level."""

    def caption(self, title: str) -> str:
        """What the film shows, and of how many flights this is the best."""
        row = self.episode
        whose = {"packaged": "the packaged policy", "train": "trained policies", "baseline": "baselines"}[self.run.kind]
        cell = summarise([other for other in self.among if other.algorithm == row.algorithm])
        return (
            f"{title} on {row.level}, start {row.episode} of the list: {row.length} steps, return {row.return_:.2f}, "
            f"cost {row.cost:.1f}, {WORDS[row.reason]}. The best of {len(self.among)} flights of {whose} there; the "
            f"return of {row.algorithm}'s {cell.episodes} is {plus_minus(cell.return_mean, cell.return_std)}."
        )


def film_best(suite: Suite, folder: Path, place: Place, console: Console) -> None:
    """Film the best flight, unless its film is there. What goes wrong is said in the report; a full disk stops all."""
    film, caption, failure = folder / FILM, folder / CAPTION, folder / NO_FILM
    try:
        best = best_flight(suite, folder)
        if best is None:
            return
        home = folder / "runs" / best.run.name
        words = best.caption(place.title(best.run, home)) + "\n"
        if film.exists() and caption.exists() and caption.read_text(encoding="utf-8") == words:
            return
        caption.unlink(missing_ok=True)
        with bar(console, "frames") as progress:
            on_frame = progress_of_frames(progress, "film", best.episode.length)
            place.film(best.run, home, best.episode, film, on_frame)
        write_whole(caption, words)
        failure.unlink(missing_ok=True)
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            raise
        film.unlink(missing_ok=True)
        write_whole(failure, " ".join(f"{type(error).__name__}: {error}".split()) + "\n")
        console.print(f"No film: {error}", style="red", highlight=False, markup=False)


def best_flight(suite: Suite, folder: Path) -> Best | None:
    """The flight with the greatest return, then the least cost: of the packaged policy where there is one, else of a
    trained one, on the level of training."""
    level = suite.train_level if suite.train_level in suite.test_levels else suite.test_levels[0]
    for kind in ("packaged", "train", "baseline"):
        flights = []
        for run in suite.runs():
            path = evaluation_path(folder, run.name, Trial(level))
            if run.kind == kind and path.exists():
                flights.extend((run, episode) for episode in read_episodes(path))
        if flights:
            run, episode = max(flights, key=lambda flight: (flight[1].return_, -flight[1].cost, -flight[1].episode))
            return Best(run, episode, [other for _, other in flights])
    return None
