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

    `read` and `written` count the bytes of calls to the system, whether or not the disk had to move for them; 0 where
    the system does not count them.
    """

    wall: float
    cpu: float
    peak: float
    read: int
    written: int


def in_turns(
    commands: Mapping[str, Sequence[str]],
    rounds: int,
    cleanup: Sequence[str] = (),
) -> dict[str, list[Run] | str]:
    """Run every command once a round, so that all commands see the same machine.

    Files that fit the patterns of `cleanup` are removed after every run, outside the measured time. Gives runs by name;
    for a command that failed, the last line that it wrote.
    """
    job = {"commands": {k: list(v) for k, v in commands.items()}, "rounds": rounds, "cleanup": list(cleanup)}
    path = os.pathsep.join([str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]).rstrip(os.pathsep)
    settings = os.environ | {"PYTHONPATH": path}
    settings.pop("PYTHONDONTWRITEBYTECODE", None)  # else modules that are not installed are compiled at every start
    done = subprocess.run([sys.executable, "-I", "-S", str(Path(__file__).with_name("_launch.py"))], text=True,
                          input=json.dumps(job), stdout=subprocess.PIPE, env=settings, check=True)  # fmt: skip
    found = json.loads(done.stdout)
    return {k: v if isinstance(v, str) else [Run(*one) for one in v] for k, v in found.items()}
