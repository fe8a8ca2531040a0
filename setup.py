"""Setup of the package: the README, with links and pictures that a package index can show.

`THALWEG_BASE_URL` is the address of the repository's files at a release, such as `https://example.org/thalweg/v0.1.0/`;
links of the README then lead there. Without it they stay relative. All other settings are in pyproject.toml.
"""

import os
import re
from pathlib import Path

from setuptools import setup

LINK = re.compile(r"\]\((?![a-z]+:|#)([^)\s]+)\)")


def readme(base: str) -> str:
    """Return the README, its relative links below the address `base` unless that is empty."""
    text = (Path(__file__).resolve().parent / "README.md").read_text(encoding="utf-8")
    if not base:
        return text
    if not re.fullmatch(r"https://[^\s/]+\.[^\s]+", base):
        raise SystemExit(
            f"THALWEG_BASE_URL is {base!r}; an address such as https://example.org/thalweg/v0.1.0/ is right"
        )
    return LINK.sub(lambda link: f"]({base.rstrip('/')}/{link[1]})", text)


if __name__ == "__main__":
    address = os.environ.get("THALWEG_BASE_URL", "")
    setup(long_description=readme(address), long_description_content_type="text/markdown")
