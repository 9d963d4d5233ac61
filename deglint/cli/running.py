"""Run a command: import it when it is called, report an error in one line with an exit code, log to stderr."""

import contextlib
import difflib
import logging
import os
import re
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Self

import click

from ..errors import DeglintError, NoWaterError
from ..timing import Reporter

LOGGERS = ("deglint", "detect")
LEVEL_NAMES = {logging.WARNING: ("warning: ", "yellow"), logging.ERROR: ("Error: ", "red")}
"""For each level of a log line: prefix of the line, and colour of the prefix on a terminal."""


class _Formatter(click.HelpFormatter):
    def write_heading(self, heading: str) -> None:
        self.write(click.style(f"{'':>{self.current_indent}}{heading}:", bold=True) + "\n")


class BoldContext(click.Context):
    """click context whose help text has bold headings on a terminal."""

    formatter_class = _Formatter


class Commands(click.Group):
    """click group that imports the module of a subcommand when it is called, so that `--help` is fast.

    An error becomes one line on stderr and an exit code, also where the group is a plugin of another program (rio).
    `home` is the package that has a module with the name of each command; `lines` has a line of help for each command.
    """

    context_class = BoldContext

    def __init__(self, *args: Any, home: str, lines: dict[str, str], **kwargs: Any) -> None:
        super().__init__(*args, context_settings={"help_option_names": ["-h", "--help"]}, **kwargs)
        self._home, self._lines = home, lines

    def run(self, arguments: list[str]) -> int:
        """Run the command with these arguments and return its exit code."""
        try:
            self.main(arguments, self.name)
        except SystemExit as end:
            return int(end.code or 0)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Count -v, also after the subcommand, because -vv prints tracebacks; then parse the arguments of the group."""
        ctx.color = False if os.environ.get("NO_COLOR") else ctx.color  # None: colours on a terminal only
        ctx.meta["verbose"] = args.count("--verbose") + sum(a.count("v") for a in args if re.fullmatch("-[vqh]+", a))
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> None:
        """Run the command that the arguments name; after an error, print one line and exit with an exit code."""
        warnings.filterwarnings("ignore", message="Dataset has no geotransform")  # from rasterio; images may have none
        with _terminable(), _quiet_libraries():
            try:
                super().invoke(ctx)
            except (click.ClickException, click.exceptions.Exit, BrokenPipeError):  # click handles these
                raise
            except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  (the user gets one line, whatever it is)
                if ctx.meta["verbose"] > 1:
                    traceback.print_exc()
                code, said = _explained(error)
                click.echo(said.replace("Error:", click.style("Error:", fg="red"), 1), err=True, color=ctx.color)
                ctx.exit(code)

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(self._lines)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name; for a wrong name, a usage error suggests the most similar name or lists all."""
        if cmd_name in self._lines:
            command: click.Command = getattr(import_module(f".{cmd_name}", self._home), cmd_name)
            return command
        if not cmd_name.startswith("-") and not ctx.resilient_parsing:
            near = difflib.get_close_matches(cmd_name, self._lines, 1)
            hint = f"Did you mean {near[0]}?" if near else f"The commands are {', '.join(self._lines)}."
            ctx.fail(f"no such command: {cmd_name}. {hint}")
        return None

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the names and one-line help of the commands to the help text, without importing the commands."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._lines.items()))


def _explained(error: BaseException) -> tuple[int, str]:
    """Exit code for an error, and the line of text to print on stderr."""
    if isinstance(error, (click.Abort, KeyboardInterrupt)):
        return 130, "\ninterrupted: no incomplete output was left."  # the line break ends the ^C of a terminal
    line = " ".join(str(error).split())
    if isinstance(error, DeglintError):
        return (3 if isinstance(error, NoWaterError) else 1), f"Error: {line}"
    if isinstance(error, MemoryError):
        return 1, "Error: out of memory. Use fewer --threads, a smaller input, or a machine with more."
    if isinstance(error, OSError) and error.strerror:
        return 1, f"Error: {error.strerror}" + (f": {error.filename}" if error.filename else "") + "."
    return 1, f"Error: {type(error).__name__}: {line} (a bug in this program; add -vv at the end to see where)"


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Treat the signal SIGTERM like Ctrl-C in the `with` block, so that temporary files are removed."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set a signal handler
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def _quiet_libraries() -> Iterator[None]:
    """Discard lines that libraries print on stderr during the `with` block.

    libtiff prints lines when a disk is full; rasterio prints tracebacks for messages of GDAL that it cannot decode.
    """
    hooks = sys.excepthook, sys.unraisablehook
    sys.excepthook, sys.unraisablehook = (lambda *_: None), (lambda _: None)
    own = sys.stderr is not None and sys.stderr is sys.__stderr__  # neither closed nor redirected by Python
    try:
        with _no_c_stderr() if own else contextlib.nullcontext():
            yield
    finally:
        sys.excepthook, sys.unraisablehook = hooks


@contextlib.contextmanager
def _no_c_stderr() -> Iterator[None]:
    """Discard what C libraries write to stderr (file descriptor 2) in the `with` block; `sys.stderr` still works."""
    real = os.dup(2)
    with open(real, "w", buffering=1, errors="replace") as kept, open(os.devnull, "w") as nowhere:  # noqa: PTH123
        os.dup2(nowhere.fileno(), 2)
        try:
            with contextlib.redirect_stderr(kept):
                yield
        finally:
            kept.flush()
            os.dup2(real, 2)


class Console(logging.Handler):
    """Logging handler that prints log lines on stderr, and on a terminal a progress line with the remaining time.

    The library logs to `LOGGERS` and their children, and installs no handler. A command installs this handler within a
    `with` block; scripts and notebooks install their own. `given` has the options of the command: with "quiet"
    only errors are shown, with "verbose" (number of -v) all messages, else messages of at least `level`.
    """

    def __init__(self, given: dict[str, Any], level: int = logging.INFO) -> None:
        super().__init__()
        quiet, verbose = given.get("quiet", False), given.get("verbose", 0)
        self._shown = logging.ERROR if quiet else logging.DEBUG if verbose else level
        self._before: list[tuple[int, bool]] = []
        self._drawn = False
        self._report = Reporter()
        self._bar = not quiet and sys.stderr is not None and sys.stderr.isatty()

    def __enter__(self) -> Self:
        for logger in map(logging.getLogger, LOGGERS):
            self._before.append((logger.level, logger.propagate))
            logger.addHandler(self)
            logger.setLevel(self._shown)
            logger.propagate = False  # a program that calls this command, such as rio, would print each line again
        return self

    def __exit__(self, *_error: object) -> None:
        self.clear()
        for logger in map(logging.getLogger, LOGGERS):
            logger.removeHandler(self)
            level, logger.propagate = self._before.pop(0)
            logger.setLevel(level)

    def emit(self, record: logging.LogRecord) -> None:
        """Print a log message on stderr; the progress line is erased first."""
        self.clear()
        name, colour = LEVEL_NAMES.get(record.levelno, ("", None))
        click.echo((click.style(name, fg=colour) if name else "") + record.getMessage(), err=True)

    def progress(self, stage: str, done: int, total: int) -> None:
        """Show that `done` of `total` parts of a stage are finished: in a terminal's progress line, or in the log."""
        if not self._bar:
            self._report(stage, done, total)
            return
        left, filled = self._report.left(stage, done, total), 30 * done // total
        said = f", {left} left" if left and done < total else ""
        line = f"{stage:<8} [{'#' * filled}{'.' * (30 - filled)}] {100 * done // total:3d} %{said}"
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)
        self._drawn = True
        if done == total:
            self.clear()

    def clear(self) -> None:
        """Erase the progress line from the terminal."""
        if self._drawn:
            click.echo("\r\x1b[K", nl=False, err=True)
            self._drawn = False
