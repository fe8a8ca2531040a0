"""Stored traces: reading, comparing with current behaviour, and writing.

`python -m tests.golden.store` compares; `--write [NAME ...]` keeps today's traces. It refuses where behaviour has
changed while the version has not.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding

from tests.golden.traces import GOLDENS, Golden, Trace
from thalweg.core.atomic_io import write_atomic

FOLDER = Path(__file__).resolve().parent / "kept"
LIBRARIES = ("numpy", "scipy", "numba", "torch")
DIGITS = 10
"""Significant digits that are stored."""


def machine_kind() -> str:
    """What decides about the last bits: the processor and the libraries."""
    return " ".join([binding.get_host_cpu_name(), *(f"{name} {version(name)}" for name in LIBRARIES)])


def trace_hash(trace: Trace) -> str:
    """A hash of all bits of a trace."""
    digest = hashlib.sha256()
    for name, values in sorted(trace.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values, np.float64).tobytes())
    return digest.hexdigest()[:16]


def path_of(name: str) -> Path:
    return FOLDER / f"{name.lower().replace(' ', '_')}.json"


def load(name: str) -> dict[str, Any]:
    """The kept trace: `version`, `exact` (a hash for each kind of machine) and `values`."""
    return json.loads(path_of(name).read_text())


def difference(golden: Golden, kept: dict[str, Any], trace: Trace) -> str:
    """How today's trace differs from the kept one, empty if it does not.

    A machine of a kind that is known must give the same bits, any other the same numbers within the tolerance.
    """
    exact = kept["exact"].get(machine_kind())
    if exact is not None:
        return "" if exact == trace_hash(trace) else _largest(golden, kept, trace, 0.0) or "bits differ in a last digit"
    return _largest(golden, kept, trace, golden.tolerance)


def _largest(golden: Golden, kept: dict[str, Any], trace: Trace, tolerance: float) -> str:
    """The part of a trace that differs by most, if that is more than the tolerance."""
    if kept["values"].keys() != trace.keys():
        return f"its parts were {', '.join(kept['values'])} and are {', '.join(trace)}"
    worst, where = 0.0, ""
    for name, values in trace.items():
        before = np.array(kept["values"][name], np.float64)
        if before.shape != np.shape(values):
            return f"{name} had shape {list(before.shape)} and has {list(np.shape(values))}"
        if (np.isnan(values) != np.isnan(before)).any():
            return f"{name} has NaN in other places"
        apart = np.abs(np.nan_to_num(values) - np.nan_to_num(before))
        relative = float((apart / np.maximum(np.abs(np.nan_to_num(before)), golden.smallest)).max(initial=0.0))
        if relative > worst:
            worst, where = relative, name
    return f"{where} differs by up to {worst:.2g} of its value" if worst > max(tolerance, 10.0**-DIGITS) else ""


def problem(name: str, golden: Golden, kept: dict[str, Any], trace: Trace) -> str:
    """What is wrong, in a sentence that says what to do; empty if nothing is."""
    write = f"python -m tests.golden.store --write {json.dumps(name) if ' ' in name else name}"
    constant = f"{golden.version_name} in thalweg/core/versions.py"
    if kept["version"] != golden.version:
        return (
            f"the golden trace of {name} is of version {kept['version']}, and {constant} is {golden.version}: {write}"
        )
    differs = difference(golden, kept, trace)
    if not differs:
        return ""
    return (
        f"{name} behaves differently ({differs}), while {constant} is still {golden.version}. Undo the change of"
        f" behaviour, or raise the version, which marks all results made before, and then: {write}"
    )


def write(name: str, golden: Golden, trace: Trace) -> None:
    """Keep a trace as that of the version, and of this kind of machine."""
    same = path_of(name).exists() and load(name)["version"] == golden.version
    kept = {
        "version": golden.version,
        "exact": (load(name)["exact"] if same else {}) | {machine_kind(): trace_hash(trace)},
        "values": load(name)["values"] if same else {part: _rounded(values) for part, values in sorted(trace.items())},
    }
    write_atomic(path_of(name), json.dumps(kept) + "\n")


def _rounded(values: np.ndarray) -> list:
    flat = [None if value != value else float(f"{value:.{DIGITS}g}") for value in np.ravel(values).astype(np.float64)]
    return np.array(flat, dtype=object).reshape(np.shape(values)).tolist()


def main(arguments: Sequence[str] | None = None) -> str | None:
    """Compare or write the traces of some names, all if none is given; returns what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(GOLDENS))
    parser.add_argument("--write", action="store_true", help="keep the traces of today")
    given = parser.parse_args(arguments)
    unknown = [name for name in given.names if name not in GOLDENS]
    if unknown:
        return f"unknown: {', '.join(unknown)}; known: {', '.join(GOLDENS)}"
    problems = []
    for name in given.names or GOLDENS:
        golden, trace = GOLDENS[name], GOLDENS[name].trace()
        kept = load(name) if path_of(name).exists() else None
        changed = kept is not None and kept["version"] == golden.version and difference(golden, kept, trace)
        if given.write and not changed:
            write(name, golden, trace)
        elif kept is None:
            problems.append(f"no golden trace of {name} is kept: python -m tests.golden.store --write")
        elif message := problem(name, golden, kept, trace):
            problems.append(message)
    return "\n".join(problems) or None


if __name__ == "__main__":
    sys.exit(main())
