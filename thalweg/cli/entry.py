"""The script `thalweg`: the command line, or advice where what it needs is not installed."""

import sys

from thalweg.core.extras import advice_for


def main() -> int:
    """Run the command line; returns the exit status, 2 where a module of an extra is missing."""
    try:
        from thalweg.cli.main import main as run
    except ModuleNotFoundError as error:
        if (advice := advice_for(error)) is None:
            raise
        print(f"thalweg: {advice}", file=sys.stderr)
        return 2
    return run()
