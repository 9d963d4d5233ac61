"""The command `deglint`: one module a command, loaded when it is called."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterator
from importlib import import_module
from typing import Any, NoReturn

import click

from .. import __version__
from ..errors import DeglintError, NoWaterError

COMMANDS = {
    "remove": "remove glint from a raster",
    "info": "say what a raster is and what it needs",
    "simulate": "make a synthetic scene of the sea, with its truth",
}


class Commands(click.Group):
    """Loads a command's module when the command is called, so that `--help` is quick."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(COMMANDS)

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name."""
        if cmd_name not in COMMANDS:
            return None
        return getattr(import_module(f".{cmd_name}", __name__), cmd_name)

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without loading them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, "--version", prog_name="deglint")
def cli() -> None:
    """Find and remove sun glint in multispectral images of the sea.

    \b
    deglint remove scene.tif clean.tif --picture look.png
    deglint info scene.tif
    """


def main() -> NoReturn:
    """Run the command and leave with its exit code: 0 done, 1 failed, 2 usage, 3 no usable water."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run the command; what goes wrong becomes one line on stderr and an exit code."""
    with _terminable(), _own_stderr() as aside:
        try:
            with cli.make_context("deglint", list(arguments)) as context:  # main() would print a line of its own
                cli.invoke(context)
        except click.exceptions.Exit as error:
            return int(error.exit_code)
        except click.ClickException as error:
            error.show()
            return error.exit_code
        except BrokenPipeError:
            _drop_stdout()
            return 1
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  (the user gets one line, whatever it is)
            code, said = _explained(error)
            if _verbosity(arguments) > 1:
                traceback.print_exc()
                aside.show()
            click.echo(said, err=True)
            return code
        aside.show()
        return 0


def _explained(error: BaseException) -> tuple[int, str]:
    """Exit code and line for an error."""
    if isinstance(error, (click.Abort, KeyboardInterrupt)):
        return 130, "interrupted: nothing was written."
    if isinstance(error, DeglintError):
        return (3 if isinstance(error, NoWaterError) else 1), "Error: " + " ".join(str(error).splitlines())
    if isinstance(error, MemoryError):
        return 1, "Error: out of memory. Use fewer --threads, or a machine with more."
    line = (str(error).splitlines() or [""])[0]
    return 1, f"Error: {type(error).__name__}: {line} (a fault of deglint's own; -vv shows where)"


def _verbosity(arguments: list[str]) -> int:
    """How often -v is given; options that failed to parse count too."""
    short = [a for a in arguments if a[:1] == "-" and a[1:2] != "-" and set(a[1:]) <= set("vqh")]
    return sum(a.count("v") for a in short) + arguments.count("--verbose")


def _interrupt(_signal: int, _frame: Any) -> NoReturn:
    raise KeyboardInterrupt


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Being told to end (kill, a closed terminal) is like Ctrl-C: leave nothing behind."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say what a signal does
        return
    ends = [s for s in (signal.SIGTERM, getattr(signal, "SIGHUP", None)) if s is not None]
    before = {s: signal.signal(s, _interrupt) for s in ends if signal.getsignal(s) == signal.SIG_DFL}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Aside:
    """What libraries write to the process's stderr by themselves (libtiff does so where a disk is full)."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def show(self) -> None:
        """Write it to the real stderr after all."""
        if self._file is not None:
            self._file.seek(0)
            sys.stderr.write(self._file.read().decode(errors="replace"))


@contextlib.contextmanager
def _own_stderr() -> Iterator[_Aside]:
    """Keep stderr for deglint's own lines; what C libraries print there is put aside."""
    if sys.stderr is None:  # closed by the caller; 2 may be any other file by now
        yield _Aside(None)
        return
    real = os.dup(2)
    python_stderr = sys.stderr
    with tempfile.TemporaryFile() as file, open(real, "w", buffering=1, errors="replace") as own:  # noqa: PTH123
        ours = _writes_to(python_stderr, 2)
        sys.stderr = own if ours else python_stderr
        os.dup2(file.fileno(), 2)
        try:
            yield _Aside(file)
        finally:
            own.flush()
            os.dup2(real, 2)
            sys.stderr = python_stderr


def _writes_to(stream: Any, descriptor: int) -> bool:
    try:
        return bool(stream.fileno() == descriptor)
    except (AttributeError, OSError, ValueError):
        return False


def _drop_stdout() -> None:
    """Nobody reads stdout any more: keep the interpreter from complaining of it at exit."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
