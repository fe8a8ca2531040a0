"""Identity of flights, by name and content: policy or saved flight, river, and plug-ins."""

from collections.abc import Sequence
from pathlib import Path

from thalweg.cli.flight_options import policy_name
from thalweg.cli.flown_flight import SAVED
from thalweg.core.cache import file_hash
from thalweg.core.plugins.source import source_files, source_hash


def flown_files(flight: str, river: Path | None, plugins: Sequence[Path]) -> dict[str, dict[str, str]]:
    """Return name and hash of the content of each file, by what it is for; a pilot has none.

    Args:
        flight: Who flies, as commands take it: a pilot, a policy, a function in a file, or a saved flight.
        river: File of a real river.
        plugins: Files of plug-ins, which count with the modules beside them that they import.

    Raises the errors of a policy that is not there, and `OSError` for another file that cannot be read.
    """
    hashes: dict[str, tuple[str, str | None]] = {"policy": (policy_name(flight), _hash_of(flight))}
    if river is not None:
        hashes["river"] = (river.name, file_hash(river))
    for number, path in enumerate(plugins, start=1):
        file = path.resolve()
        hashes[f"plugin {number}"] = (path.name, source_hash(source_files(file, file.parent)))
    return {what: {"file": name, "content": found} for what, (name, found) in hashes.items() if found is not None}


def _hash_of(flight: str) -> str | None:
    """Return the hash of a policy, a function or a saved flight; None for a pilot."""
    from thalweg.bench.evaluate.baselines import BASELINES
    from thalweg.bench.evaluate.functions import FunctionPolicy, is_reference
    from thalweg.bench.packaged import policy_path
    from thalweg.train.run_in_folder import policy_file
    from thalweg.viewer.flight.flyers import PILOTS

    if flight in PILOTS or flight in BASELINES:
        return None
    if Path(flight).suffix == SAVED:
        return file_hash(Path(flight))
    if is_reference(flight):
        return FunctionPolicy.load(flight).source
    return file_hash(policy_file(policy_path(flight)))
