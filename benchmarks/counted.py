"""Run one command in this process and say what it cost: `python -m benchmarks.counted deglint remove ...`.

The last line of stdout is JSON: processor time [s], largest resident memory [MB], bytes read and written by calls to
the system (whether or not the disk had to move for them).
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path


def main() -> None:
    """Run it."""
    if sys.argv[1] == "deglint":
        from deglint.cli import run
    else:
        from detect.cli import run
    start = time.perf_counter()
    code = run(sys.argv[2:])
    wall = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_SELF)
    counts = {k: int(v) for k, v in (line.split(":") for line in Path("/proc/self/io").read_text().splitlines())}
    said = {
        "wall": wall, "cpu": used.ru_utime + used.ru_stime, "peak": used.ru_maxrss * 1024 / 1e6,
        "read": counts["rchar"], "written": counts["wchar"],
    }  # fmt: skip
    print(json.dumps(said))
    sys.exit(code)


if __name__ == "__main__":
    main()
