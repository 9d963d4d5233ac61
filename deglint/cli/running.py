"""Running a command: subcommands are imported when called, an error becomes one line and an exit code."""

from __future__ import annotations

import contextlib
import difflib
import errno
import os
import re
import signal
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import click
from click.shell_completion import shell_complete

from ..errors import DeglintError, NoWaterError
from ..shown import shown
from .grouped import BoldContext

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)


class Commands(click.Group):
    """Group that imports the module of a subcommand when it is called, so that `--help` is fast.

    `home` is the package whose module NAME defines the command NAME; `lines` has a line of help for each command.
    """

    context_class = BoldContext

    def __init__(self, *args: Any, home: str, lines: dict[str, str], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._home, self._lines = home, lines

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(self._lines)

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name."""
        return getattr(import_module(f".{cmd_name}", self._home), cmd_name) if cmd_name in self._lines else None

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The command that the first argument names; a wrong name is answered with the nearest one, or with all."""
        name = args[0]
        if name not in self._lines and not name.startswith("-") and not ctx.resilient_parsing:
            near = difflib.get_close_matches(name, self._lines, 1)
            hint = f"Did you mean {near[0]}?" if near else f"The commands are {', '.join(self._lines)}."
            ctx.fail(f"no such command: {name}. {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without loading them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._lines.items()))


def run(cli: click.Group, program: str, arguments: list[str]) -> int:
    """Run a command; an error becomes one line on stderr and an exit code."""
    complete = os.environ.get(f"_{program.upper()}_COMPLETE")
    if complete:
        return shell_complete(cli, {}, program, f"_{program.upper()}_COMPLETE", complete)
    _moved().clear()  # of an earlier command in this process
    warnings.filterwarnings("ignore", message="Dataset has no geotransform")  # rasterio's, of images without a place
    colour = False if os.environ.get("NO_COLOR") else None  # None: where a terminal shows them
    with _terminable(), _own_stderr() as show_aside, _nothing_hidden():
        try:  # main() would print a line of its own
            with cli.make_context(program, list(arguments), color=colour) as context:
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
                show_aside()
            click.echo(said.replace("Error:", click.style("Error:", fg="red"), 1), err=True, color=colour)
            return code
        show_aside()
        return 0


def plugin(cli: click.Group, name: str) -> click.Command:
    """The command as a plugin of another program, such as rio; arguments and exit codes are passed through."""

    @click.command(
        name,
        short_help=cli.get_short_help_str(100),
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False},
    )
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    @click.pass_context
    def command(context: click.Context, arguments: tuple[str, ...]) -> None:
        context.exit(run(cli, context.command_path, list(arguments)))

    return command


def printable(text: str) -> str:
    """Text as one line without control characters: names in files may contain terminal commands."""
    return shown(text.replace("\n", " ").replace("\t", " "))


def _explained(error: BaseException) -> tuple[int, str]:
    """Exit code and line for an error."""
    if isinstance(error, (click.Abort, KeyboardInterrupt)):
        return 130, _interrupted()
    if isinstance(error, DeglintError):
        return (3 if isinstance(error, NoWaterError) else 1), "Error: " + printable(" ".join(str(error).splitlines()))
    if isinstance(error, MemoryError):
        return 1, "Error: out of memory. Use fewer --threads, or a machine with more."
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return 1, "Error: too many open files. Use fewer --threads or inputs, or raise the limit (ulimit -n)."
    if isinstance(error, OSError) and error.errno in _NO_ROOM and not error.filename:
        return 1, f"Error: cannot write to standard output: {error.strerror}."  # who writes a file reports its errors
    if isinstance(error, FileNotFoundError) and "temporary directory" in str(error):
        return 1, "Error: there is no directory for temporary files. Set TMPDIR to one that can be written to."
    line = (str(error).splitlines() or [""])[0]
    return 1, f"Error: {type(error).__name__}: {printable(line)} (a fault of deglint's own; -vv shows where)"


def _moved() -> Any:
    """Outputs that were moved into place so far."""
    return getattr(sys.modules.get("deglint.raster.scratch"), "MOVED", [])


def _interrupted() -> str:
    """Message after an interruption: which outputs are complete."""
    if not (moved := _moved()):
        return "interrupted: nothing was written."
    others = " and others" if len(moved) > 1 else ""
    return f"interrupted; {len(moved)} outputs were written and are whole: {printable(str(moved[0]))}{others}."


def _verbosity(arguments: list[str]) -> int:
    """Number of -v; options that failed to parse are counted too."""
    short = [a for a in arguments if a[:1] == "-" and a[1:2] != "-" and set(a[1:]) <= set("vqh")]
    return sum(a.count("v") for a in short) + arguments.count("--verbose")


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP like Ctrl-C, so that temporary files are removed."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say what a signal does
        return
    ends = [signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
    interrupt = signal.default_int_handler
    before = {s: signal.signal(s, interrupt) for s in ends if signal.getsignal(s) == signal.SIG_DFL}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _own_stderr() -> Iterator[Callable[[], None]]:
    """Keep messages of C libraries out of stderr (libtiff prints some when a disk is full).

    Yields a function that prints them after all.
    """
    if sys.stderr is None:  # closed by the caller; 2 may be any other file by now
        yield lambda: None
        return
    real, python_stderr = os.dup(2), sys.stderr
    with _nameless() as file, open(real, "w", buffering=1, errors="replace") as own:  # noqa: PTH123

        def show() -> None:
            file.seek(0)
            sys.stderr.write(file.read().decode(errors="replace"))

        if _writes_to(python_stderr, 2):
            sys.stderr = own
        hooks = sys.excepthook, sys.unraisablehook
        # rasterio would print here what it cannot decode in GDAL's messages
        sys.excepthook, sys.unraisablehook = (lambda *_: None), (lambda _: None)
        os.dup2(file.fileno(), 2)
        try:
            yield show
        finally:
            sys.excepthook, sys.unraisablehook = hooks
            own.flush()
            os.dup2(real, 2)
            sys.stderr = python_stderr


class _Seen:
    """Output stream that removes control characters, except those of the progress line and a few colours."""

    _OWN = re.compile(r"(\x1b\[(?:K|0m|1m|31m|33m))")

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the printable part of a text."""
        if not isinstance(text, str) or text.isprintable():
            return int(self._stream.write(text))
        head = "\r" if text.startswith("\r") else ""  # a line that is drawn anew
        parts = self._OWN.split(text.removeprefix(head).removesuffix("\r"))
        parts[::2] = map(shown, parts[::2])
        tail = "\r" if head and text.endswith("\r") and len(text) > 1 else ""
        self._stream.write(head + "".join(parts) + tail)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def _nothing_hidden() -> Iterator[None]:
    """Remove control characters from everything that is printed: names in files may contain terminal commands."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (stream and _Seen(stream) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _nameless() -> Any:
    """An anonymous temporary file; in memory if possible, as there may be no directory for temporary files."""
    with contextlib.suppress(OSError, AttributeError):
        return os.fdopen(os.memfd_create("stderr"), "w+b")
    with contextlib.suppress(OSError):
        return tempfile.TemporaryFile()
    return open(os.devnull, "w+b")  # noqa: PTH123  (the caller closes it)


def _writes_to(stream: Any, descriptor: int) -> bool:
    try:
        return bool(stream.fileno() == descriptor)
    except (AttributeError, OSError, ValueError):
        return False


def _drop_stdout() -> None:
    """Redirect a closed stdout to the null device, so that the interpreter does not report it at exit."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
