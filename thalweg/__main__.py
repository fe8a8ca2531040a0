"""Runs the `thalweg` command for `python -m thalweg`."""

import sys

from thalweg.cli.entry import main

if __name__ == "__main__":
    sys.exit(main())
