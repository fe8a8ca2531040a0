"""Kills of training commands at random moments: the same command resumes and ends with the same files.

    python benchmarks/reliability/kills.py                            # 50 kills of each command
    python benchmarks/reliability/kills.py --commands train --kills 6
    python benchmarks/reliability/kills.py --minutes 25               # begins no trial later than that
    python benchmarks/reliability/kills.py --smoke                    # one kill of `train`, no table

Each command runs undisturbed; then in trials, each in a folder of its own. In a trial it is killed (SIGKILL) one to
three times, at random moments after its folder was created, and then resumed to its end. Moments are shares of the
processor time of the undisturbed run, so that other work on the machine does not move them. At the end all files must
have the numbers of the undisturbed run, without any time; what was finished at a kill (a policy, an encoder, the
flights of a trial) must be the same file, not another one with the same content; and no checkpoint may be lost or
written again, nor an epoch of an encoder lost. kills.csv has a row for each kill, with the versions of what its command
trains; a trial that has its rows, of today's versions and without a fault, is skipped, and the rows of one that is run
again replace all of its earlier ones. The settings are tiny, and a checkpoint is written after every update.
"""

import argparse
import csv
import io
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random

from pieces import Clock, Pieces

from thalweg.core import versions
from thalweg.core.parent_process import ending_with_parent

HERE = Path(__file__).resolve().parent
TABLE = HERE / "kills.csv"
TRIAL = ("command", "trial")
KEY = (*TRIAL, "kill")
MADE_WITH = "made_with"
"""Column of the versions of what a command trains."""
NO_KILL = "none"
"""In place of the number of a kill, for a command that ended before it."""
RUN, SUITE = "run", "tiny.yaml"
"""Names of the run's folder and the suite's file in the folder of a trial."""
TICK_S = 0.01
"""Time between two looks at a process."""
LONGEST_S = 1800.0
"""Time after which a run that is neither finished nor killed counts as stuck."""
TINY_SUITE = """
arms: [{algorithm: PPO, seeds: [0, 1], steps: 1024, settings: {steps_per_update: 256}}]
train_level: Easy
test_levels: [Easy]
episodes: 2
num_envs: 4
baselines: [hover]
packaged: false
observation: privileged
film: none
"""
COMMANDS: dict[str, tuple[str, ...]] = {
    "train": (
        *("train", "--algorithm", "FOCOPS", "--level", "Easy", "--observation", "privileged", "--num-envs", "4"),
        *("--steps", "4096", "--set", "steps_per_update=256", "--out", RUN),
    ),
    "bench": ("bench", SUITE, "--jobs", "1", "--out", RUN),
    "imitate": (
        *(
            "imitate",
            "--levels",
            "Easy",
            "--world-seeds",
            "1000",
            "--num-envs",
            "4",
            "--steps",
            "640",
            "--threads",
            "1",
        ),
        *("--set", "filters=[4, 4, 4, 4]", "features=16", "memory_size=8", "hidden=[16]", "sequence=8"),
        *("gate_rivers=1", "teacher_steps=64", "--out", RUN),
    ),
    "encoder": (
        *("encoder", "train", "--level", "Easy", "--inputs", "mask", "--latent", "2", "--images", "24"),
        *("--held-out", "4", "--epochs", "6", "--out", RUN),
    ),
}
"""The arguments of each command; its folder is the working one, so that no path differs between trials."""
MADE_BY = {
    "train": f"FOCOPS {versions.ALGORITHMS['FOCOPS']}, training {versions.TRAINING}",
    "bench": f"PPO {versions.ALGORITHMS['PPO']}, training {versions.TRAINING}, evaluation {versions.EVALUATION}",
    "imitate": f"imitation {versions.IMITATION}",
    "encoder": f"encoder {versions.ENCODER}",
}
"""Today's versions of what each command trains."""
LASTING = ("policy.safetensors", "encoder.safetensors", "evaluation/*.csv")
"""Files that are written once, when what they hold is finished."""
CHECKPOINTS = re.compile(r"(^|/)(checkpoints/|checkpoint\.)")
NOT_COMPARED = re.compile(
    r"(^|/)(checkpoints/|checkpoint\.|logs/|events\.|report/.*\.(html|png|svg|md|tex)$|error\.txt|\.[^/]*\.part)"
)
"""Files that hold times, tables that are there as CSV too, and hidden ones that killed processes leave half-written."""
A_TIME = re.compile(r"second|minutes|time|_s$")
"""Names of columns and keys that hold times."""


@dataclass(frozen=True)
class Undisturbed:
    """What the run that was never killed took and left."""

    created_s: float
    """Processor time until its folder was there."""
    total_s: float
    contents: dict[str, str]


def child(name: str) -> int:
    """Run a command in this process, with a checkpoint after every update."""
    from thalweg.cli.main import main as thalweg
    from thalweg.train import run_in_folder

    loop = run_in_folder.training_loop

    def often(*arguments: object) -> None:
        loop(*arguments[:-1], 0.0)  # pyright: ignore[reportArgumentType, reportCallIssue]

    run_in_folder.training_loop = often
    return thalweg(list(COMMANDS[name]))


def start(name: str, folder: Path) -> subprocess.Popen:
    """Start a command in the folder of a trial, as the leader of a group of processes; its output goes to a file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / SUITE).write_text(TINY_SUITE)
    log = open(folder / "output.txt", "a")  # noqa: SIM115 (the process has it)
    command = ending_with_parent([sys.executable, __file__, "--child", name])
    return subprocess.Popen(command, cwd=folder, stdout=log, stderr=log, process_group=0)


def processor_s(pid: int) -> float:
    """Return the processor time that a process has taken so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def watch(process: subprocess.Popen, created: Path, kill_after_s: float | None) -> tuple[float, bool]:
    """Wait for the end of a process, or kill it so much processor time after a file `created` was there.

    Returns its processor time until that file was there, and whether it was killed. Raises `RuntimeError` for a process
    that is stuck.
    """
    begun, created_s = time.monotonic(), None
    while process.poll() is None:
        used = processor_s(process.pid)
        if created_s is None and created.exists():
            created_s = used
        if kill_after_s is not None and created_s is not None and used - created_s >= kill_after_s:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return created_s, True
        if time.monotonic() - begun > LONGEST_S:
            os.killpg(process.pid, signal.SIGKILL)
            raise RuntimeError(f"{process.args} is stuck")
        time.sleep(TICK_S)
    return created_s or 0.0, False


def finish(name: str, folder: Path) -> float:
    """Run or resume a command to its end; returns the processor time until its folder was there.

    Raises `RuntimeError`, with its last words, if it fails.
    """
    process = start(name, folder)
    created_s, _ = watch(process, folder / RUN, None)
    if process.returncode:
        raise RuntimeError(f"{name} ended with {process.returncode}: {(folder / 'output.txt').read_text()[-2000:]}")
    return created_s


def undisturbed(name: str, folder: Path) -> Undisturbed:
    """Return what a command does that is not killed; twice, since the first one builds rivers and compiles."""
    for _ in range(2):
        shutil.rmtree(folder, ignore_errors=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        created_s = finish(name, folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    total_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Undisturbed(created_s, total_s, contents(folder / RUN))


def contents(folder: Path) -> dict[str, str]:
    """Return what the files of a run hold, without times: tables and JSON as text, others by their bytes."""
    found = {}
    for path in sorted(each for each in folder.rglob("*") if each.is_file()):
        name = path.relative_to(folder).as_posix()
        if NOT_COMPARED.search(name):
            continue
        if path.suffix == ".csv":
            found[name] = without_times(path.read_text())
        elif path.suffix == ".json":
            found[name] = json.dumps(_without_times(json.loads(path.read_text())))
        else:
            found[name] = path.read_bytes().hex()
    return found


def without_times(table: str) -> str:
    """Return a table without its columns of times."""
    rows = list(csv.reader(io.StringIO(table)))
    kept = [index for index, column in enumerate(rows[0]) if not A_TIME.search(column)] if rows else []
    return "\n".join(",".join(row[index] for index in kept) for row in rows)


def _without_times(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_times(each) for key, each in value.items() if not A_TIME.search(key)}
    return [_without_times(each) for each in value] if isinstance(value, list) else value


def lasting(folder: Path) -> dict[str, tuple[int, int]]:
    """Return inode and time of change of the files of a run that are finished."""
    paths = (path for pattern in LASTING for path in folder.rglob(pattern))
    return {path.relative_to(folder).as_posix(): (path.stat().st_ino, path.stat().st_mtime_ns) for path in paths}


def checkpoints(folder: Path) -> dict[str, dict[int, tuple[int, int]]]:
    """Return inode and time of change of the checkpoints of the runs in a folder, by run and step."""
    found: dict[str, dict[int, tuple[int, int]]] = {}
    for path in folder.rglob("checkpoints/[0-9]*/state.json"):
        run = path.parents[2].relative_to(folder).as_posix()
        found.setdefault(run, {})[int(path.parent.name)] = (path.stat().st_ino, path.stat().st_mtime_ns)
    return found


def newest_checkpoint(folder: Path) -> str:
    """Return the names of the newest checkpoints of the runs in a folder."""
    return " ".join(str(max(steps)) for steps in checkpoints(folder).values())


def epochs(folder: Path) -> int:
    """Return the number of finished epochs of an encoder, whose table follows its checkpoint; 0 of other runs."""
    table = folder / "metrics.csv"
    is_encoder = table.is_file() and not (folder / "checkpoints").is_dir()
    return len(table.read_text().splitlines()) - 1 if is_encoder else 0


@dataclass(frozen=True)
class Secured:
    """What a command has secured, so that no kill may undo it."""

    finished: dict[str, tuple[int, int]]
    checkpoints: dict[str, dict[int, tuple[int, int]]]
    epochs: int

    @classmethod
    def of(cls, folder: Path) -> "Secured":
        """Return what a command has secured in the folder of its run."""
        return cls(lasting(folder), checkpoints(folder), epochs(folder))

    def undone(self, later: "Secured") -> Iterator[str]:
        """Yield what is not as it was, or is done again, some time later."""
        for path, file in self.finished.items():
            if file != later.finished.get(path):
                yield f"{path} was finished and is another file now"
        for run, before in self.checkpoints.items():
            now = later.checkpoints.get(run, {})
            is_finished = any(path.rpartition("/")[0] == run.removeprefix(".") for path in later.finished)
            if max(before) > max(now, default=0) and not is_finished:
                yield f"checkpoint {max(before)} of {run} is lost"
            for step in before.keys() & now.keys():
                if before[step] != now[step]:
                    yield f"checkpoint {step} of {run} was written again"
        if later.epochs < self.epochs:
            yield f"{self.epochs} epochs were finished, and {later.epochs} are now"


def trial(name: str, number: int, folder: Path, usual: Undisturbed) -> Iterator[dict[str, object]]:
    """Kill a command one to three times, resume it to its end, and yield a row for each kill; for one that fails before
    it is killed, one without a kill."""
    random = Random(f"{name} {number}")
    shutil.rmtree(folder, ignore_errors=True)
    rows: list[dict[str, object]] = []
    faults: list[str] = []
    before = Secured({}, {}, 0)
    for kill in range(1 + number % 3):
        after_s = random.random() * max(usual.total_s - usual.created_s, TICK_S)
        _, killed = watch(process := start(name, folder), folder / RUN, after_s)
        if not killed:
            if process.returncode:
                faults.append(f"resumed: ended with {process.returncode}")
            break
        now = Secured.of(folder / RUN)
        faults += before.undone(now)
        before = now
        row: dict[str, object] = dict(zip(KEY, (name, number, kill), strict=True))
        left = {
            "after_s": f"{after_s:.2f}",
            "finished": len(now.finished),
            "checkpoint": newest_checkpoint(folder / RUN),
        }
        rows.append(row | left)
    try:
        finish(name, folder)
    except RuntimeError as error:
        faults.append(" ".join(str(error).split())[:300])
    faults += before.undone(Secured.of(folder / RUN))
    there = contents(folder / RUN)
    for path in sorted(usual.contents.keys() | there.keys()):
        if usual.contents.get(path) != there.get(path):
            faults.append(f"{path} differs from that of the undisturbed run")
    if faults and not rows:  # it ended before it could be killed
        nothing: dict[str, object] = {"after_s": "", "finished": 0, "checkpoint": ""}
        rows.append({**dict(zip(KEY, (name, number, NO_KILL), strict=True)), **nothing})
    for row in rows:
        told = {"faults": len(faults), "first": faults[0].replace(",", ";") if faults else ""}
        yield row | told | {MADE_WITH: MADE_BY[name]}
    if not faults:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", nargs="+", choices=[*COMMANDS], default=[*COMMANDS])
    parser.add_argument("--kills", type=int, default=50, help="kills of each command")
    parser.add_argument("--minutes", type=float, help="begin no trial later than so many minutes after the start")
    parser.add_argument("--out", type=Path, default=TABLE)
    parser.add_argument("--runs", type=Path, default=HERE.parents[1] / "runs" / "kills", help="folder of the runs")
    parser.add_argument("--smoke", action="store_true", help="one kill of train, without a table")
    parser.add_argument("--child", choices=[*COMMANDS], help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        return child(given.child)
    runs, failed = given.runs.resolve(), False
    table, clock = Pieces(given.out, TRIAL), Clock(given.minutes)
    for name in ("train",) if given.smoke else given.commands:
        usual, wanted, number = None, 1 if given.smoke else given.kills, 0
        done = 0
        while done < wanted:
            today = (name, str(number), MADE_BY[name])
            known = [row for row in table.rows if tuple(row[each] for each in (*TRIAL, MADE_WITH)) == today]
            if given.smoke or not known or known[0]["faults"] != "0":
                if clock.is_over:
                    return 1 if failed else 0
                usual = usual or undisturbed(name, runs / f"{name}-undisturbed")
                known = list(trial(name, number, runs / f"{name}-{number}", usual))
                for row in known:
                    failed |= row["faults"] != 0
                    print(*(f"{key} {value}" for key, value in row.items()), flush=True)
                if not given.smoke:
                    table.replace((name, str(number)), known)
            if known and known[0]["kill"] == NO_KILL:
                return 1  # it fails by itself, and would in every trial
            done, number = done + len(known), number + 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
