"""The `thalweg` command: parses a command line into one of the commands, runs it, and prints errors as one line.

Each command is a dataclass in a file of its own. Its fields are the options, their docstrings the help, and `run` does
the work. What a command needs is imported when it runs, so that `thalweg --help` answers at once.
"""

import contextlib
import io
import os
import re
import select
import shlex
import shutil
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from typing import Annotated, Any, TextIO

import tyro
from tyro.conf import OmitSubcommandPrefixes, subcommand

from thalweg.cli.bench import Bench
from thalweg.cli.command import COMMAND_LINE, NOTHING_SAVED, Command
from thalweg.cli.encoder import ENCODER_COMMANDS, Encoder
from thalweg.cli.evaluate import Evaluate
from thalweg.cli.export import Export
from thalweg.cli.film import Film
from thalweg.cli.fly import Fly
from thalweg.cli.follow import Follow
from thalweg.cli.imitate import Imitate
from thalweg.cli.leaderboard import Leaderboard
from thalweg.cli.options import REGISTRY, UsageError
from thalweg.cli.oracle import FlyOracle
from thalweg.cli.record import Record
from thalweg.cli.render import RenderFrames
from thalweg.cli.report import Report
from thalweg.cli.speed import Speed
from thalweg.cli.train import Train
from thalweg.cli.wording import in_options
from thalweg.cli.world import DrawWorld
from thalweg.core.atomic_io import is_disk_error
from thalweg.core.extras import advice_for
from thalweg.core.plugins.lookup import add_files
from thalweg.core.seeds import MAX_SEED, parse_seeds
from thalweg.core.suggestion import did_you_mean

DESCRIPTION = (
    "A photo-realistic river world and a benchmark of safe reinforcement learning on it."
    " Further options: --version; --debug shows the traceback of an error."
)

COMMANDS = {
    "world": DrawWorld,
    "render": RenderFrames,
    "encoder": Encoder,
    "train": Train,
    "imitate": Imitate,
    "evaluate": Evaluate,
    "fly": Fly,
    "film": Film,
    "record": Record,
    "export": Export,
    "follow": Follow,
    "bench": Bench,
    "report": Report,
    "leaderboard": Leaderboard,
    "oracle": FlyOracle,
    "speed": Speed,
}


COLOUR = re.compile(r"\x1b\[[0-9;]*m")
"""A code that sets a colour on a terminal."""
NAMES_IN_USAGE = re.compile(r"\{\w+(,\w+){4,}\}")
"""Names of all commands in a usage, which are listed below it one by one."""
CLOSED_PIPE = 128 + 13
"""Exit status where nobody reads the output any more: that which a shell gives to a process ended by SIGPIPE."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; returns the exit status: 2 for an error that the user can mend."""
    try:
        try:
            return _run(arguments)
        finally:
            sys.stdout.flush()  # here, because Python's own flush at exit can't be caught
    except BrokenPipeError:
        closed = [stream for stream in (sys.stdout, sys.stderr) if _is_closed_pipe(stream)]
        if not closed:
            raise
        for stream in closed:  # what is still buffered is flushed at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return CLOSED_PIPE


def _run(arguments: Sequence[str] | None) -> int:
    """Run a command line, and print errors; returns the exit status. Raises `BrokenPipeError`."""
    _print_any_character()
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    given = [argument for argument in given if argument != "--debug"]
    if given == ["--version"]:
        print(f"thalweg {version('thalweg')}")
        return 0
    command: Command | None = None
    try:
        COMMAND_LINE.set(shlex.join(["thalweg", *given]))
        command = _parse(given)
        _check_seeds(command)
        add_files(getattr(command, "plugin", ()))
        if arguments is None:
            warnings.showwarning = _show_warning
            threading.excepthook = _show_thread_error
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # SIGTERM interrupts like Ctrl-C
        return command.run()
    except KeyboardInterrupt:
        print(f"\nInterrupted. {NOTHING_SAVED if command is None else command.after_interrupt()}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise
    except Exception as error:
        if debug or not _is_expected(error):
            traceback.print_exc()
            return 2 if _is_expected(error) else 1
        print(f"thalweg: {_in_words(error, command)}", file=sys.stderr)
        return 2


def _in_words(error: Exception, command: Command | None) -> str:
    """Return an error as one line that names options; that of a full disk says what becomes of the command."""
    if isinstance(error, ModuleNotFoundError):
        return advice_for(error) or str(error)
    if not isinstance(error, OSError):
        return str(error) if command is None else in_options(str(error), command)
    if not is_disk_error(error):
        return f"{error.filename}: {str(error.strerror).lower()}" if error.strerror else str(error)
    where = "a file" if error.filename is None else error.filename
    resumes = f". {command.after_interrupt()}" if command is not None and command.resumes else ""
    return f"{where} cannot be written: {error.strerror}{resumes}"


def _print_any_character() -> None:
    """Let output whose encoding lacks a character, as a pipe's on Windows may, show something in its place.

    Results show a question mark; errors show the character's number, since a name in them must stay one that exists.
    """
    for stream, errors in ((sys.stdout, "replace"), (sys.stderr, "backslashreplace")):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)


def _is_closed_pipe(stream: TextIO) -> bool:
    """Return whether a stream is a pipe that nobody reads any more; other pipes can break too, such as a worker's."""
    if not hasattr(select, "poll"):  # Windows, where a closed pipe is an OSError of another kind
        return False
    poll = select.poll()
    poll.register(stream.fileno(), 0)
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """A warning as a line, without the place in the code that it came from."""
    print(f"Warning: {message}", file=sys.stderr)


def _show_thread_error(arguments: threading.ExceptHookArgs) -> None:
    """Show an error that ended a thread, unless it is of the disk: whoever waits for the thread raises that again."""
    if arguments.exc_value is None or not is_disk_error(arguments.exc_value):
        threading.__excepthook__(arguments)


def _parse(arguments: list[str]) -> Command:
    """Return the command with its options; a command that is named is parsed alone, so that hints are its own.

    `train PPO` is short for `train --algorithm PPO`.
    """
    if arguments[:1] == ["train"] and len(arguments) > 1 and not arguments[1].startswith("-"):
        arguments = ["train", "--algorithm", *arguments[1:]]
    if arguments and arguments[0] == "encoder":
        return _parse_one_of(ENCODER_COMMANDS, "thalweg encoder", str(Encoder.__doc__), arguments[1:])
    return _parse_one_of(COMMANDS, "thalweg", DESCRIPTION, arguments)


def _parse_one_of(commands: Mapping[str, Any], prog: str, description: str, arguments: list[str]) -> Command:
    if arguments and arguments[0] in commands:
        kind = commands[arguments[0]]
        with contextlib.redirect_stdout(_WrappedLines(sys.stdout)):
            return tyro.cli(kind, prog=f"{prog} {arguments[0]}", args=arguments[1:], registry=REGISTRY)
    if arguments and not arguments[0].startswith("-"):
        near = did_you_mean(arguments[0], commands)
        raise UsageError(f"{prog} has no command {arguments[0]!r}{near}; there are {', '.join(commands)}")
    kinds: Any = None
    for name, kind in commands.items():
        one = Annotated[kind, subcommand(name, prefix_name=False)]
        kinds = one if kinds is None else kinds | one
    with contextlib.redirect_stdout(_WrappedLines(sys.stdout)):
        return tyro.cli(
            OmitSubcommandPrefixes[kinds], prog=prog, description=description, args=arguments, registry=REGISTRY
        )


class _WrappedLines:
    """A stream that wraps long lines at the terminal's width: tyro prints a usage and a description as one line."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        text = NAMES_IN_USAGE.sub("COMMAND", text)
        self._stream.write("\n".join(map(_wrapped, text.split("\n"))))
        return len(text)

    def flush(self) -> None:
        self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _wrapped(line: str) -> str:
    """Return a line with breaks between words where it would be wider than the terminal; colours have no width."""
    width = shutil.get_terminal_size().columns
    if len(COLOUR.sub("", line)) <= width:
        return line
    lines = [""]
    for word in line.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if len(COLOUR.sub("", longer)) <= width or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
    return "\n".join(lines)


def _is_expected(error: Exception) -> bool:
    """Whether an error says what is wrong with what it was given: our own, the system's of a file, or that of a module
    which an extra of the package installs."""
    if isinstance(error, ModuleNotFoundError):
        return advice_for(error) is not None
    of_file = isinstance(error, OSError) and (error.filename is not None or is_disk_error(error))
    return of_file or isinstance(error, UsageError) or type(error).__module__.split(".")[0] == "thalweg"


def _check_seeds(command: Any) -> None:
    """Raise `UsageError` for a seed out of range or lists of seeds that cannot be read, before anything is done."""
    for field in fields(command):
        value: Any = getattr(command, field.name)
        if is_dataclass(value):
            _check_seeds(value)
        option = f"--{field.name.replace('_', '-')}"
        if field.name.endswith("seeds"):
            parse_seeds(value, option, UsageError)
        elif field.name.endswith("seed") and isinstance(value, int) and value < 0:
            raise UsageError(f"{option} must be 0 or more, not {value}")
        elif field.name.endswith("seed") and isinstance(value, int) and value > MAX_SEED:
            raise UsageError(f"{option} must be at most {MAX_SEED}, not {value}")


if __name__ == "__main__":
    sys.exit(main())
