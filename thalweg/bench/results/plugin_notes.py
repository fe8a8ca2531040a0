"""Notes on the plug-ins that results were made with: those that are not here, and those whose source has changed."""

from collections.abc import Iterator

from thalweg.bench.results.results import Results
from thalweg.bench.results.run_versions import plugin_of
from thalweg.core.plugins.record import PluginError


def plugin_notes(results: Results) -> Iterator[str]:
    """Yield a line for each plug-in that cannot be compared, or of which one version has several sources."""
    found: dict[str, dict[int | None, set[str]]] = {}
    for run, sources in results.sources.items():
        for name, source in sources.items():
            by_version = found.setdefault(name, {})
            by_version.setdefault(results.versions.get(run, {}).get(name), set()).add(source)
    functions = {function["name"] for function in results.suite.get("policies", [])}
    for name, by_version in found.items():
        yield from _notes_of(name, by_version, is_function=name in functions)


def _notes_of(name: str, by_version: dict[int | None, set[str]], *, is_function: bool) -> Iterator[str]:
    try:
        plugin = None if is_function else plugin_of(name)
    except PluginError as error:
        yield f"Not compared: {name} is a plug-in that cannot be used: {error}"
        return
    if plugin is None and not is_function:
        yield f"Not compared: {name} is a plug-in that is not here; its results are shown as they are (--plugin FILE)"
    for version, sources in by_version.items():
        now = {plugin.source} if plugin is not None and plugin.record.version == version else set[str]()
        if len(sources | now) > 1:
            hashes = ", ".join(sorted(sources)) + (f" and {plugin.source} now" if plugin and now - sources else "")
            yield (
                f"Changed: version {version} of the plug-in {name} has several sources ({hashes}): raise its version if"
                " results change"
            )
