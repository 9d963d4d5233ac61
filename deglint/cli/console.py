"""Output of a command on stderr: log lines, and on a terminal a progress line with the remaining time.

The library logs to "deglint", "detect" and their child loggers, and installs no handler. A command installs this
handler while it runs; scripts and notebooks install their own.
"""

import logging
import sys
from typing import Any, Self

import click

from ..timing import Reporter

LOGGERS = ("deglint", "detect")
LEVEL_NAMES = {logging.WARNING: ("warning: ", "yellow"), logging.ERROR: ("Error: ", "red")}
"""Level of a log line: prefix of the line, and colour of the prefix on a terminal."""


class Console(logging.Handler):
    """Handler of the project's loggers, installed within its `with` block.

    `given` holds the options of the command, with "verbose" (number of -v) and "quiet". Without these two, messages of
    `level` and above are shown.
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
        """Write a log line; a progress line is erased first."""
        self.clear()
        name, colour = LEVEL_NAMES.get(record.levelno, ("", None))
        click.echo((click.style(name, fg=colour) if name else "") + record.getMessage(), err=True)

    def progress(self, stage: str, done: int, total: int) -> None:
        """Redraw the progress line on a terminal; elsewhere log a line from time to time."""
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
        """Erase the progress line."""
        if self._drawn:
            click.echo("\r\x1b[K", nl=False, err=True)
            self._drawn = False
