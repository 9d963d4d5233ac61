"""Run commands in turns and measure them. `processes.in_turns` starts this module as a small process of its own.

On Linux the peak memory of a child is at least what its parent held at the start: nothing large is imported here.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path


def once(command: list[str]) -> list[float] | str:
    """Run a command. Return the values of a `processes.Run` in order or, if it failed, a line that says why."""
    os.sync()  # earlier runs must not leave data to be written during this one
    start = time.perf_counter()
    try:
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    except OSError as error:
        return f"cannot start {command[0]}: {error.strerror}"
    assert child.stderr is not None
    written = child.stderr.read()
    moved, counts = Path(f"/proc/{child.pid}/io"), [0, 0]
    if moved.exists():  # on Linux, until the process is waited for
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
        counts = [int(line.split()[1]) for line in moved.read_text().splitlines()[:2]]
    _, status, usage = os.wait4(child.pid, 0)
    wall = time.perf_counter() - start
    child.stderr.close()
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        lines = written.decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"exit code {child.returncode}"
    unit = 1 if sys.platform == "darwin" else 1024
    return [wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit / 1e6, *counts]


def main() -> None:
    """Read commands, rounds and cleanup as JSON from stdin; write the measurements by command as JSON to stdout."""
    job = json.load(sys.stdin)
    found: dict[str, list[list[float]] | str] = {name: [] for name in job["commands"]}
    for _ in range(job["rounds"]):
        for name, command in job["commands"].items():
            runs = found[name]
            if isinstance(runs, str):
                continue
            one = once(command)
            for pattern in job["cleanup"]:
                for left in Path(pattern).parent.glob(Path(pattern).name):
                    left.unlink()
            if isinstance(one, str):
                found[name] = one
            else:
                runs.append(one)
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
