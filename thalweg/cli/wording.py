"""Errors in the words of the command line: options in place of Python's arguments, and a value to try."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, get_args, get_origin

from tyro.conf import Positional, UseAppendAction

EXAMPLES = {
    "jobs": "2",
    "cpus": "1",
    "threads": "1",
    "rivers_in_memory": "8",
    "world_seeds": "1000:1016",
    "world_seed": "0",
    "held_out_seeds": "3000:3006",
    "images": "2000",
    "held_out": "200",
    "epochs": "100",
    "latent": "16",
    "width_m": "12",
    "start_m": "0",
    "length_m": "300",
    "smooth_m": "4",
}
"""Values to try of options without a default."""
OTHER_NAMES = {"in_memory": "rivers_in_memory", "size_px": "size"}
"""Arguments that are named otherwise than the options that they are passed as."""
VERBS = "must|is|are"


def in_options(message: str, command: Any) -> str:
    """Return an error with the options of a command in place of the arguments that they are passed as.

    An argument of several words, such as `num_envs`, is recognised anywhere, `rivers=episode` as an option with its
    value, and one of a single word, such as `steps`, as the subject of a sentence only. If the value of an option is
    wrong, one to try is added.
    """
    options = {name: (f"--{name.replace('_', '-')}", example) for name, example in _fields_of(command)}
    for argument, name in OTHER_NAMES.items():
        if name in options:
            message = re.sub(rf"(?<![-\w.]){argument}(?= )", name, message)
    for name, (option, _) in options.items():
        message = re.sub(rf"(?<![-\w.]){name}=(?=\w)", f"{option} ", message)
        if "_" in name:
            message = re.sub(rf"(?<![-\w./])(?<!property ){name}(?![\w=]|\.\w)", option, message)
        message = re.sub(rf"(?<![^ ])(?<![^ :;] ){name} (?={VERBS}\b)", f"{option} ", message)
    if "set" in options:
        message = re.sub(r"(?<!-)\bset (?=\w+=\w)", "--set ", message)
    return message + _to_try(message, options)


def _fields_of(command: Any) -> Iterator[tuple[str, str]]:
    """Yield the name of each option of a command, and a value to try, empty if there is none."""
    for field in fields(command):
        value = getattr(command, field.name)
        if is_dataclass(value):
            yield from _fields_of(value)
            continue
        if get_origin(field.type) is Annotated and {Positional, UseAppendAction} & {*get_args(field.type)}:
            continue  # it is given by its place, or a value at a time
        default = None if field.default is MISSING or isinstance(field.default, bool) else field.default
        words = default if isinstance(default, tuple) else () if default is None else (default,)
        yield field.name, shlex.join(map(str, words)) or EXAMPLES.get(field.name, "")


def _to_try(message: str, options: dict[str, tuple[str, str]]) -> str:
    """Return `; such as --option VALUE` for the first option whose value is wrong; empty without one."""
    for option, example in options.values():
        if example and re.match(rf"{option} ({VERBS})\b", message) and "such as" not in message:
            return f"; such as {option} {example}" if _fits(example, message) else ""
    return ""


def _fits(example: str, message: str) -> bool:
    """Return whether a value keeps to the least or the greatest one that a message names, if it names one."""
    named = re.search(r"must be at (least|most) (\d[\d,]*)", message)
    if not named or not example.isdigit():
        return True
    bound = int(named[2].replace(",", ""))
    return int(example) >= bound if named[1] == "least" else int(example) <= bound
