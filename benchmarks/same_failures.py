"""Violations of two students on the same rivers: of each alone, of the mean of both, and of one with its mirror image.

    python benchmarks/same_failures.py runs/any_river/FIRST runs/any_river/SECOND --levels Hard
    python benchmarks/same_failures.py --write        # table and picture of docs/imitation-findings.md, flying nothing

All fly the `unseen` flights of `any_river.py` by their most probable options. `mean` takes the options that are most
probable on average over both students; `mirror` is the first one, on average over what it does for the image and for
the image in a mirror. Each sees the options that were taken. same_failures.csv has a row for each flight that ends in a
violation, and one without a river for each policy and level that was flown, which is not flown again. It holds two
students of the same kind; others need another file.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from any_river import VERSIONS, Cell
from page_sections import replace_section
from PIL import Image
from river_flights import fly
from tables import of_versions, put, rows_of

from thalweg.algos import AlgorithmError
from thalweg.algos.imitation.student import ALGORITHM
from thalweg.algos.policy.player import NetworkPlayer
from thalweg.algos.policy.policy import Policy
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.course import UNSEEN, Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label
from thalweg.bench.packaged import policy_path
from thalweg.bench.report.table import frame, markdown
from thalweg.core.atomic_io import atomic_path, write_atomic
from thalweg.core.cache import file_hash
from thalweg.render import Renderer
from thalweg.train import load_policy
from thalweg.train.flip import flipped
from thalweg.train.imitation.mirroring import GREATEST_OPTION, SIDEWAYS
from thalweg.train.observations import observation_of
from thalweg.train.run_in_folder import policy_file

HERE = Path(__file__).resolve().parent
TABLE, PAGE, SECTION = HERE / "same_failures.csv", HERE.parent / "docs" / "imitation-findings.md", "same failures"
FIRST, SECOND, MEAN, MIRROR = POLICIES = "first", "second", "mean", "mirror"
WORDS = {
    FIRST: "the first student",
    SECOND: "the second",
    MEAN: "the mean of both",
    MIRROR: "the first and its mirror image",
}
EPISODES = 300
"""Flights of each policy on each level."""
SOON = 30
"""Steps from a start, as many as those of `starts.py`."""
PICTURE, SHOWN, COLUMNS_SHOWN = HERE.parent / "docs" / "images" / "same_failures.jpg", 12, 3
"""What the starts show at which both students fail soon, on the last level that was flown: so many, in columns."""
KEY = ("policy", "students", "level", "episodes", *VERSIONS)
"""Columns that identify the flights of a policy on a level; `students` are hashes of both files."""
COLUMNS = (*KEY, "world_seed", "reason", "length")
Member = tuple[NetworkPlayer, bool]
"""A player, and whether it sees the mirror image."""


class Mean:
    """Players of students in the same environments, which take the options that are most probable on average."""

    def __init__(self, members: Sequence[Member]) -> None:
        self.members = members

    def __call__(self, images: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return options [N, A] for images uint8 [N, H, W, C], of which `fresh` [N] bool begin an episode."""
        total = np.zeros(())
        for player, mirrored in self.members:
            player(flipped(images) if mirrored else images, fresh)
            log_probs = player.log_probs()
            assert log_probs is not None  # of students, which were asked just now
            probabilities = np.exp(log_probs)
            if mirrored:
                probabilities[:, SIDEWAYS] = probabilities[:, SIDEWAYS, ::-1]
            total = total + probabilities
        options = total.argmax(axis=-1)
        for player, mirrored in self.members:
            player.correct(mirror_image(options) if mirrored else options)
        return options


def mirror_image(options: np.ndarray) -> np.ndarray:
    """Return the options [N, A] that are those of others in a mirror."""
    image = options.copy()
    image[:, SIDEWAYS] = GREATEST_OPTION - image[:, SIDEWAYS]
    return image


class Together:
    """Students that act as `Mean`, with the interface of a policy."""

    def __init__(self, students: Sequence[tuple[Policy, bool]]) -> None:
        self.students = students
        self.about, self.actions = students[0][0].about, students[0][0].actions

    def player(self, num_envs: int, *, deterministic: bool = True, generator: Any = None) -> Mean:
        """Return the players of N environments; they are always deterministic."""
        return Mean([(student.player(num_envs, deterministic=True), mirrored) for student, mirrored in self.students])


def policy_named(name: str, folders: Sequence[Path]) -> Any:
    """Return one of `POLICIES` of two students, by the folders of their runs.

    Raises `ResultsError` unless both are students that see the same.
    """
    first, second = map(load_policy, folders)
    kinds = [(each.about.algorithm, observation_of(each)) for each in (first, second)]
    if kinds[0] != kinds[1] or kinds[0][0] != ALGORITHM:
        told = " and ".join(f"{algorithm} of {seen}" for algorithm, seen in kinds)
        raise ResultsError(f"both must be students ({ALGORITHM}) that see the same, not {told}")
    if name == MEAN:
        return Together([(first, False), (second, False)])
    if name == MIRROR:
        return Together([(first, False), (first, True)])
    return second if name == SECOND else first


def flights_of(name: str, level: str, folders: Sequence[Path], episodes: int) -> list[dict[str, str]]:
    """Return the rows of a policy's flights on so many rivers of a level: one for each violation, and one for all."""
    key = dict(zip(KEY, key_of(name, level, folders, episodes), strict=True))
    flown = fly(
        policy_named(name, folders),
        Cell(name, 0, 0, "unseen", level, episodes).courses(),
        Label(name, 0, level),
        EvaluationConfig(episodes, deterministic=True),
    )
    failed = [
        key | {"world_seed": str(e.world_seed), "reason": e.reason, "length": str(e.length)} for e in flown if e.cost
    ]
    return [*failed, key | {"world_seed": "", "reason": "", "length": ""}]


def key_of(name: str, level: str, folders: Sequence[Path], episodes: int) -> tuple[str, ...]:
    """Return the values of `KEY`; students are identified by the hashes of their files."""
    students = " ".join(file_hash(policy_file(folder)) for folder in folders)
    return (name, students, level, str(episodes), *map(str, VERSIONS.values()))


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the table of the page, of the rows of one pair of students with the same number of flights."""
    lines = []
    for level in dict.fromkeys(row["level"] for row in rows):
        violations = {
            name: {row["world_seed"]: int(row["length"]) for row in rows if is_failure(row, name, level)}
            for name in POLICIES
            if any((row["policy"], row["level"], row["world_seed"]) == (name, level, "") for row in rows)
        }
        for name, found in violations.items():
            soon = sum(length <= SOON for length in found.values())
            shared = str(len(found.keys() & violations[FIRST].keys())) if FIRST in violations else ""
            lines.append([level, WORDS[name], str(len(found)), str(soon), shared])
    header = ["level", "policy", "violations", f"within {SOON} steps of the start", "on rivers where the first has one"]
    return markdown(frame(header, lines))


def picture(rows: Sequence[Mapping[str, str]]) -> np.ndarray | None:
    """Return the first frames of flights in which both students fail soon, each beside its water mask, [H, W, 3] uint8;
    None if there are none.

    They are of the last level of the rows, up to `SHOWN` of them.
    """
    level = rows[-1]["level"]
    both = [
        {int(row["world_seed"]) for row in rows if is_failure(row, name, level) and int(row["length"]) <= SOON}
        for name in (FIRST, SECOND)
    ]
    if not (seeds := sorted(both[0] & both[1])[:SHOWN]):
        return None
    shown = [first_frame(level, seed, int(rows[-1]["episodes"])) for seed in seeds]
    shown += [np.zeros_like(shown[0])] * (-len(shown) % COLUMNS_SHOWN)
    lines = [np.concatenate(shown[at : at + COLUMNS_SHOWN], axis=1) for at in range(0, len(shown), COLUMNS_SHOWN)]
    return np.concatenate(lines)


def first_frame(level: str, world_seed: int, episodes: int) -> np.ndarray:
    """Return what the flight on an unseen river begins with: the frame, and its mask in white, [H, 2 W, 3] uint8."""
    (course,) = Course.of_seeds(level, [world_seed], EvaluationConfig(episodes))
    one = course.only(world_seed - UNSEEN)
    frame_of_start = Renderer([one.world]).render(one.starts, time_s=one.clocks_s)[0]
    return np.concatenate([frame_of_start[..., :3], np.repeat(frame_of_start[..., 3:], 3, axis=-1)], axis=1)


def is_failure(row: Mapping[str, str], name: str, level: str) -> bool:
    """Return whether a row is that of a violation of a policy on a level."""
    return (row["policy"], row["level"]) == (name, level) and row["world_seed"] != ""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("students", nargs="*", help="two students: folders of runs, files, or packaged policies")
    parser.add_argument("--policies", nargs="+", choices=POLICIES, default=POLICIES)
    parser.add_argument("--levels", nargs="+", choices=("Easy", "Medium", "Hard"), default=["Medium", "Hard"])
    parser.add_argument("--episodes", type=int, default=EPISODES, help="flights of each policy on each level")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="fly nothing, but write the table of the page")
    given = parser.parse_args(arguments)
    rows = rows_of(given.out, COLUMNS)
    if given.write:
        current = of_versions(rows, VERSIONS)
        if len(pairs := sorted({f"{row['students']}, {row['episodes']} flights" for row in current})) > 1:
            parser.error(f"{given.out} holds several pairs of students or numbers of flights: {'; '.join(pairs)}")
        text = table(current) if current else "Nothing was measured with today's versions.\n"
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, text))
        if current and (shown := picture(current)) is not None:
            with atomic_path(PICTURE) as draft:
                Image.fromarray(shown).save(draft, "JPEG", quality=85)
        return 0
    if len(given.students) != 2 or given.episodes < 1:
        parser.error(f"two students and at least one episode are needed, not {len(given.students)}, {given.episodes}")
    students = [policy_path(student) for student in given.students]
    try:
        policy_named("mean", students)
    except (AlgorithmError, ResultsError) as error:
        parser.error(str(error))
    done = {tuple(row[name] for name in KEY) for row in rows if not row["world_seed"]}
    for level in given.levels:
        for name in given.policies:
            if key_of(name, level, students, given.episodes) not in done:
                put(given.out, COLUMNS, flights_of(name, level, students, given.episodes), KEY)
                print(f"{name} on {level}: flown", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
