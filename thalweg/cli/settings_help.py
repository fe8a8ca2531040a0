"""`--set help`: the settings of an algorithm, their defaults and their meanings, from the docstrings of its config."""

import json
import shutil
import textwrap
from collections.abc import Collection
from dataclasses import fields
from typing import Any

from thalweg.core.config import to_plain
from thalweg.core.field_docs import field_docs

HELP = ("help",)
"""What --set is given for the list."""
NARROWEST, INDENT = 60, "    "


def print_settings(name: str, config: Any, without: Collection[str] = ()) -> None:
    """Print each setting of a config as it is given to --set, with its value, and below it what it means."""
    docs, width = field_docs(type(config)), max(shutil.get_terminal_size().columns, NARROWEST)
    print(f"Settings of {name} and their defaults; --set NAME=VALUE changes them:\n")
    for field in fields(config):
        if field.name in without:
            continue
        print(f"{field.name}={json.dumps(to_plain(getattr(config, field.name)))}")
        text = docs.get(field.name, "(its class has no docstring for it)")
        print(textwrap.fill(text, width, initial_indent=INDENT, subsequent_indent=INDENT))
