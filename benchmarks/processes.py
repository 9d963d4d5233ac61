"""Measure whole processes in turns: wall time, processor time, peak memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .timing import ROOT


@dataclass(frozen=True)
class Run:
    """One run of a process: wall time and processor time [s], peak resident memory [MB].

    `read` and `written` are the bytes of calls to the system, whether or not they reach the disk; 0 on systems that
    do not count them.
    """

    wall: float
    cpu: float
    peak: float
    read: int
    written: int


def in_turns(
    commands: Mapping[str, Sequence[str]], rounds: int, cleanup: Sequence[str] = ()
) -> dict[str, list[Run] | str]:
    """Run every command once in each round, so that the load of the machine is similar for all commands.

    Files that match the patterns of `cleanup` are removed after every run, outside the measured time. Returns the runs
    by the command's name; for a command that failed, a line that says why.
    """
    job = {"commands": {k: list(v) for k, v in commands.items()}, "rounds": rounds, "cleanup": list(cleanup)}
    path = os.pathsep.join([str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]).rstrip(os.pathsep)
    settings = os.environ | {"PYTHONPATH": path}
    settings.pop("PYTHONDONTWRITEBYTECODE", None)  # else modules that are not installed are compiled at every start
    done = subprocess.run([sys.executable, "-I", "-S", str(Path(__file__).with_name("_launch.py"))], text=True,
                          input=json.dumps(job), stdout=subprocess.PIPE, env=settings, check=True)  # fmt: skip
    found = json.loads(done.stdout)
    return {k: v if isinstance(v, str) else [Run(*one) for one in v] for k, v in found.items()}
