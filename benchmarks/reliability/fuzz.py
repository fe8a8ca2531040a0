"""Fuzzing of every file that is read: each mutated file gives a clear error or a right answer.

    python benchmarks/reliability/fuzz.py                                 # all, in pieces of 1,000 files of a kind
    python benchmarks/reliability/fuzz.py --kinds world policy --pieces 2
    python benchmarks/reliability/fuzz.py --minutes 25                    # begins no piece later than that
    python benchmarks/reliability/fuzz.py --only world 3 517              # one file again, with its traceback
    python benchmarks/reliability/fuzz.py --smoke                         # 20 files of each kind, no table

A file fails its reader by an error that is none of the project's own, by one that does not name the file or is longer
than a page, by an answer with a number that is not finite, by taking more than ten seconds of processor time, or by
taking more than two gigabytes. fuzz.csv has a row for each piece; a piece without failures is skipped, one with
failures is run again, so that a reader that was mended is tried on the same files. Failing files are kept in `--kept`.
At one commit, a piece has the same files on every machine; another commit may have other samples or mutations. A
column names the last commit of the code that read a piece, which is not read again when the code changes.
"""

import argparse
import faulthandler
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType

from fuzz_kinds import KINDS
from kind import Kind, UnsoundError, check_sound
from pieces import Clock, Pieces

HERE = Path(__file__).resolve().parent
TABLE = HERE / "fuzz.csv"
FILES = 1000
"""Files of each piece."""
LONGEST_S, MOST_BYTES, LONGEST_MESSAGE = 10, 2_000_000_000, 100_000
KEY = ("kind", "piece", "files")


class TooSlowError(BaseException):
    """A reader that took too long; no `Exception`, so that no reader catches it."""


@dataclass
class Tally:
    """What became of the files of a piece."""

    read: int = 0
    """Files that gave an answer."""
    refused: int = 0
    """Files that gave a clear error."""
    slowest_s: float = 0.0
    failures: list[str] = field(default_factory=list)
    """Number of the file, and what its reader did."""


def mutated_file(kind: Kind, name: str, samples: list[bytes], piece: int, number: int) -> bytes:
    """Return one file of a piece: a sample after one mutation, or now and then after several."""
    random = Random(f"{name}/{piece}/{number}")
    content = random.choice(samples)
    for _ in range(random.choice((1, 1, 1, 2))):
        try:
            content = kind.mutate(content, random)
        except Exception:  # what was mutated before is no longer of this kind, or empty
            break
    return content


def outcome(kind: Kind, path: Path) -> tuple[str, str]:
    """Return `read`, `refused` or `failed`, and why."""
    try:
        check_sound(kind.read(path))
    except UnsoundError as error:
        return "failed", f"silent: {error}"
    except kind.errors as error:
        return _judged(str(error), path)
    except (Exception, TooSlowError) as error:
        return "failed", f"{type(error).__name__}: {str(error)[:200]}"
    return "read", ""


def _judged(message: str, path: Path) -> tuple[str, str]:
    """Return whether the message of an error is clear."""
    if path.name not in message and str(path.parent) not in message:
        return "failed", f"the error does not name the file: {message[:200]}"
    if len(message.replace(str(path), "")) > LONGEST_MESSAGE:
        return "failed", f"an error of {len(message)} characters: {message[:100]}"
    return "refused", message


def fuzz(name: str, piece: int, files: int, kept: Path | None = None) -> Tally:
    """Read the files of a piece; those that fail are written to `kept`."""
    kind, tally = KINDS[name], Tally()
    with tempfile.TemporaryDirectory() as scratch:
        samples = kind.samples(Path(scratch))
        path = Path(scratch) / kind.file
        for content in samples:  # a sample must be read; the first time, readers compile what they call
            path.write_bytes(content)
            check_sound(kind.read(path))
        signal.signal(signal.SIGPROF, _too_slow)
        for number in range(files):
            content = mutated_file(kind, name, samples, piece, number)
            path.write_bytes(content)
            begun = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
            try:
                result, why = outcome(kind, path)
            except TooSlowError:
                result, why = "failed", "TooSlowError"
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
            tally.slowest_s = max(tally.slowest_s, time.process_time() - begun)
            if result == "failed":
                tally.failures.append(f"{number}: {why}")
                if kept is not None:
                    kept.mkdir(parents=True, exist_ok=True)
                    (kept / f"{name.replace(' ', '-')}-{piece}-{number}-{kind.file}").write_bytes(content)
            else:
                setattr(tally, result, getattr(tally, result) + 1)
    return tally


def again(name: str, piece: int, number: int) -> None:
    """Read one file of a piece and print what its reader did."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as scratch:
        samples = kind.samples(Path(scratch))
        path = Path(scratch) / kind.file
        path.write_bytes(mutated_file(kind, name, samples, piece, number))
        print(path.read_bytes()[:2000])
        try:
            value = kind.read(path)
            check_sound(value)
            print(f"read: {value!s:.500}")
        except BaseException:
            traceback.print_exc()


def last_commit() -> str:
    """Return date and hash of the last commit of the code; `unknown` without its history."""
    command = ["git", "-C", str(HERE), "log", "-1", "--format=%cs %h"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TooSlowError(f"more than {LONGEST_S} s")


def bound_memory() -> None:
    """Let a reader that takes too much memory fail, and print where a process is that crashes."""
    faulthandler.enable()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, resource.RLIM_INFINITY))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS], default=[*KINDS])
    parser.add_argument("--pieces", type=int, help="most pieces of each kind")
    parser.add_argument("--minutes", type=float, help="begin no piece later than so many minutes after the start")
    parser.add_argument("--out", type=Path, default=TABLE)
    parser.add_argument("--kept", type=Path, default=HERE.parents[1] / "runs" / "fuzz", help="folder of failing files")
    parser.add_argument("--only", nargs=3, metavar=("KIND", "PIECE", "NUMBER"), help="read one file again")
    parser.add_argument("--smoke", action="store_true", help="20 files of each kind, without a table")
    given = parser.parse_args()
    bound_memory()
    if given.only:
        again(given.only[0], int(given.only[1]), int(given.only[2]))
        return 0
    files = 20 if given.smoke else FILES
    whole = {name: KINDS[name].wanted // FILES for name in given.kinds}
    asked = 1 if given.smoke else given.pieces
    most = whole if asked is None else dict.fromkeys(whole, asked)
    table, clock, failed = Pieces(given.out, KEY), Clock(given.minutes), 0
    commit = last_commit()  # of the code that this process has loaded
    for piece in range(max(most.values())):
        for name in given.kinds:
            if piece >= most[name]:
                continue
            row = None if given.smoke else table.row(name, piece, files)
            if row is not None and row["failed"] == "0":
                continue
            if clock.is_over:
                return 1 if failed else 0
            tally = fuzz(name, piece, files, None if given.smoke else given.kept)
            failed += len(tally.failures)
            print(
                f"{name} {piece}: {tally.read} read, {tally.refused} refused, {len(tally.failures)} failed", flush=True
            )
            for line in tally.failures[:20]:
                print(f"  {line}", flush=True)
            if not given.smoke:
                counts = {"read": tally.read, "refused": tally.refused, "failed": len(tally.failures)}
                identity = dict(zip(KEY, (name, piece, files), strict=True))
                table.add(identity | counts | {"slowest_s": f"{tally.slowest_s:.2f}", "commit": commit})
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
