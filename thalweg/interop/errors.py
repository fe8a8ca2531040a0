"""Errors of the adapters."""


class InteropError(ValueError):
    """An adapter was given what it, or its library, cannot carry; the message names it and what would do."""


def not_installed(error: ModuleNotFoundError, library: str, install: str) -> ModuleNotFoundError:
    """Return an error that says how to install the library of an adapter, in place of that of a failed import."""
    return ModuleNotFoundError(f"{library} is not installed ({error}); {install}", name=error.name, path=error.path)
