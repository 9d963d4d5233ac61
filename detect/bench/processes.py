"""Measure whole processes in turns: wall time, processor time, peak memory."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from deglint.errors import DeglintError

ROOT = Path(__file__).resolve().parents[2]
"""Where the packages lie; children find them there, whatever else is installed."""
Command = Sequence[str]


@dataclass(frozen=True)
class Run:
    """One run of a process: wall time and processor time [s], largest resident memory [MB]."""

    wall: float
    cpu: float
    peak: float


def in_turns(
    commands: Mapping[str, Command],
    rounds: int,
    cleanup: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
) -> dict[str, list[Run] | str]:
    """Run every command once a round, so that all see the same machine.

    Parameters
    ----------
    commands : mapping of str to sequence of str
        By name.
    rounds : int
    cleanup : sequence of str
        Patterns of files to remove after every run; the time for that does not count.
    environment : mapping, optional
        Variables to add.

    Returns
    -------
    dict
        Runs by name; for a command that failed, the last line that it wrote.
    """
    asked = {"commands": {k: list(v) for k, v in commands.items()}, "rounds": rounds, "cleanup": list(cleanup)}
    said = output_of([sys.executable, "-I", "-S", str(Path(__file__).with_name("_launch.py"))], json.dumps(asked),
                     environment)  # fmt: skip
    found = json.loads(said)
    return {k: v if isinstance(v, str) else [Run(*one) for one in v] for k, v in found.items()}


def output_of(command: Command, given: str = "", environment: Mapping[str, str] | None = None) -> str:
    """What a command writes to stdout; it, and what it started, ends when this is interrupted.

    Raises
    ------
    DeglintError
        It fails.
    """
    path = os.pathsep.join([str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]).rstrip(os.pathsep)
    settings = os.environ | {"PYTHONPATH": path} | dict(environment or {})
    settings.pop("PYTHONDONTWRITEBYTECODE", None)  # else modules that are not installed are compiled at every start
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          env=settings, start_new_session=True) as child:  # fmt: skip
        try:
            out, said = child.communicate(given)
        except BaseException:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(child.pid, signal.SIGKILL)
            raise
    if child.returncode:
        raise DeglintError((said.strip().splitlines() or [f"{command[0]}: exit code {child.returncode}"])[-1])
    return out
