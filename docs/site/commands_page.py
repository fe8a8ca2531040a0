"""Page of the command line, made from the help that the parser of each command prints."""

import contextlib
import io
import os
import re
from collections.abc import Iterator
from unittest import mock

from thalweg.cli.encoder import ENCODER_COMMANDS
from thalweg.cli.main import COMMANDS, main

WIDE = "2000"
"""Characters of a line of help: so many that no text is broken."""
HEAD = """# Commands

What `thalweg COMMAND --help` prints of each command. Results go to stdout; notices, warnings and bars of progress to
stderr. Options may stand in any order. Numbers may be written as 200000,
200_000 or 2e5. `thalweg --version` prints the version; `--debug` shows the traceback of an error.
"""
ENTRY = re.compile(r"^  (?P<option>\S.*?)(?:\s{2,}(?P<help>\S.*))?$")
OPTION = re.compile(r"--[a-z][a-z-]*")
NO_DEFAULT = re.compile(r" \(default: (None)?\)$")
"""What the parser says of an option without a default."""


def commands() -> list[str]:
    """Return the words of every command, in the order of `thalweg --help`."""
    names = [[name] if name != "encoder" else [f"encoder {each}" for each in ENCODER_COMMANDS] for name in COMMANDS]
    return [name for several in names for name in several]


def help_of(command: str) -> str:
    """Return what `thalweg COMMAND --help` prints on a terminal that is wide enough for every line."""
    printed = io.StringIO()
    plain = {"COLUMNS": WIDE, "NO_COLOR": "1"}
    with mock.patch.dict(os.environ, plain), contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([*command.split(), "--help"])
    return printed.getvalue()


def entries(text: str) -> Iterator[tuple[str, str]]:
    """Yield each option of a help, and each argument that is given by its place, with what is said of it."""
    lines = iter(text.splitlines())
    for line in lines:
        found = ENTRY.match(line.rstrip())
        if found and not found["option"].startswith("-h,"):
            yield found["option"], found["help"] or next(lines).strip()


def section(command: str) -> str:
    """Return the part of the page on one command, in Markdown."""
    text = help_of(command)
    usage, description = text.split("\n\n")[:2]
    rows = [f"- `{option.replace('{None}|', '')}`: {_escaped(told)}" for option, told in entries(text)]
    return "\n".join(
        [f"## thalweg {command}\n", f"{description}\n", f"    {usage.removeprefix('usage: ')}\n", *rows, ""]
    )


def _escaped(told: str) -> str:
    """Return the help of an option as Markdown, its options as code, without a default that is none."""
    parts = NO_DEFAULT.sub("", told).split("`")  # every other one is code already
    parts[::2] = [OPTION.sub(r"`\g<0>`", part.replace("<", "&lt;").replace("*", r"\*")) for part in parts[::2]]
    return "`".join(parts)


def commands_page() -> str:
    """Return the page in Markdown: a section for each command."""
    return "\n".join([HEAD, *map(section, commands())])
