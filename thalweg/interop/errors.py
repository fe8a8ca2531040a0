"""Errors of the adapters."""


class InteropError(ValueError):
    """An option or a value that an adapter or its library cannot take; the message names it and what would be right."""


def not_installed(error: ModuleNotFoundError, library: str, install: str) -> ModuleNotFoundError:
    """Return an error that says how to install `library`, to raise in place of the error of its failed import."""
    return ModuleNotFoundError(f"{library} is not installed ({error}); {install}", name=error.name, path=error.path)
