"""Hostile and broken input: `python -m tests.fuzz --cases 3000` tries mutants of small files on the commands.

Case n of a seed is always the same. Each runs in a process that may die without harm, with little memory and time. What
may come is a result, or one line that says what is wrong; anything else is printed, and the file kept on request.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import resource
import select
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # as a module of a package it does not find what lies beside it

from fuzz_samples import samples

ROOT = Path(__file__).parents[1]
MEMORY = 6 << 30
"""Address space of a worker [byte]."""
MOST_RESIDENT = 1500
"""Resident memory that no case may reach [MB]."""
PATIENCE = 20.0
"""Time for one case [s]."""
OURS = "own; -vv"
"""What the commands say of an error that nobody foresaw."""
PIXELS = "3e7"
"""DEGLINT_MAX_PIXELS for the cases: what lies within the limit must be worked on, which takes its time."""
ODD = (0, 1, 2, 3, 7, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 62, (1 << 64) - 1)
ODD_TEXT = (b"1e400", b"-1", b"0", b"99999999999999999999", b"NaN", b"Infinity", b"null", b"[]", b"{}", b"\x00",
            b"\xff", b'""', b"../../x", b"/etc/passwd", b"/vsimem/x", b"\x1b[2J", "\u202e".encode(), b"[" * 3000,
            b"{'a':" * 300, b"true", b"\\ud800", b"1" * 5000)  # fmt: skip


def mutant(data: bytes, name: str, dice: random.Random) -> bytes:
    """A file with some of its bytes changed: mostly in front, where headers are."""
    out = bytearray(data)
    text = not name.endswith((".tif", ".img", ".png"))
    for _ in range(dice.choice((1, 1, 1, 2, 3, 8))):
        if not out:
            break
        reach = len(out) if text or dice.random() < 0.3 else min(len(out), 500)
        at = dice.randrange(reach)
        what = dice.randrange(8)
        if what == 0:
            out[at] ^= 1 << dice.randrange(8)
        elif what == 1 and dice.random() < 0.4:
            del out[at:]
        elif what == 2:
            del out[at : at + dice.randrange(1, 20)]
        elif what == 3:
            out[at:at] = out[at : at + dice.randrange(1, 200)] * dice.choice((1, 2, 50))
        elif text:
            out[at : at + dice.choice((0, 1, 4))] = dice.choice(ODD_TEXT)
        elif what == 4:
            out[at : at + 40] = dice.randbytes(40)
        else:
            size, code = dice.choice(((2, "H"), (4, "I"), (8, "Q")))
            at = at // 2 * 2
            out[at : at + size] = struct.pack(f"<{code}", dice.choice(ODD) % (1 << (8 * size)))
    return bytes(out)


def tiff_mutant(data: bytes, dice: random.Random) -> bytes:
    """A classic TIFF with the count, type or value of a tag changed."""
    out = bytearray(data)
    first = struct.unpack_from("<I", out, 4)[0]
    if out[:4] != b"II*\x00" or first + 2 > len(out):
        return mutant(data, "x.tif", dice)
    for _ in range(dice.choice((1, 1, 2, 4))):
        entry = first + 2 + 12 * dice.randrange(struct.unpack_from("<H", out, first)[0] + 1)
        place, size, code = dice.choice(((0, 2, "H"), (2, 2, "H"), (4, 4, "I"), (8, 4, "I"), (8, 4, "I"), (8, 2, "H")))
        value = dice.choice((*ODD, dice.randrange(1 << 16), first)) % (1 << (8 * size))
        if entry + 12 <= len(out):
            struct.pack_into(f"<{code}", out, entry + place, value)
    return bytes(out)


_SCENES = (
    "deglint remove -q {scene} {out} {run}", "deglint remove -q {scene} {out} {run} --nir 1",
    "deglint remove -q {scene} {out}", "deglint info {scene}", "deglint info --json {scene}",
    "deglint remove -q {tif} {out} --method hedley --sample all --mask {scene}",
    "deglint plan -q --place {scene} -o {json}",
    "rxdetect score -q {scene} {out}", "rxdetect score -q {tif} {out} --mask {scene}",
    "rxdetect score -q {tif} {out} --background {scene}", "rxdetect roc -q {scores} {scene} --bootstrap 0",
    "rxdetect roc -q {scene} {scores} --bootstrap 0 --report {html}", "deglint batch {recipe} {scene} --dry-run -q",
)  # fmt: skip
_AREAS = (
    "deglint remove -q {tif} {out} --method hedley --sample {text}",
    "rxdetect score -q {tif} {out} --background {text}",
    "deglint remove -q {tif} {out} --method hedley --mask {text}", "rxdetect score -q {tif} {out} --mask {text}",
    "rxdetect roc -q {scores} {text} --bootstrap 0", "deglint plan -q --place {text} -o {json}",
    "deglint info {tif} --sample {text}",
)  # fmt: skip
COMMANDS = {
    "area.geojson": _AREAS,
    "recipe.toml": ("deglint batch {text} {tif} --dry-run -q",),
    "mission.toml": ("deglint plan -q --mission {text} -o {json}",),
    "list.csv": ("deglint batch {recipe} {text} --dry-run -q",),
    "stac.json": ("deglint batch {recipe} {text} --dry-run -q",),
    "model.json": ("deglint remove -q {tif} {out} --model {text}",),
    "background.json": ("rxdetect score -q {tif} {out} --background {text}",),
}
"""What is run on a file of each kind; on all others what is run on scenes."""
PRODUCTS = ("o.tif", "o.tif.json", "scores.tif.json", "raw.bin", "envi.img.aux.xml", "plain.png.aux.xml")
BESIDE = ("plain.tif", "mosaic.vrt", "raw.bin", "envi.img", "envi.hdr")
"""Files that others lead to."""


def case(number: int, seed: int, found: dict[str, Path], work: Path) -> list[str]:
    """Write the files of a case; the arguments of the command to run on them, the program first."""
    from common import RUN

    dice = random.Random(f"{seed}:{number}")
    often = ("plain.tif", "lzw.tif", "deflate.tif", "tiles.tif", "zstd.tif", "mosaic.vrt", "envi.hdr", "area.geojson")
    name = dice.choice([*sorted(set(found) - {"scores.tif"}), *often])
    data = found[name].read_bytes()
    changed = tiff_mutant(data, dice) if name.endswith(".tif") and dice.random() < 0.5 else mutant(data, name, dice)
    for beside in BESIDE if name.endswith((".vrt", ".hdr", ".img")) else ():
        (work / beside).write_bytes((found["plain.tif"].parent / beside).read_bytes())
    path = work / name
    path.write_bytes(changed)
    scene = work / "envi.img" if name.startswith("envi") else path
    words = {"scene": scene, "text": path, "tif": found["plain.tif"], "scores": found["scores.tif"],
             "recipe": found["recipe.toml"], "out": work / "out" / "out.tif", "json": work / "out" / "out.json",
             "html": work / "out" / "out.html"}  # fmt: skip
    command = dice.choice(COMMANDS.get(name, _SCENES))
    return [text for word in command.split() for text in (RUN if word == "{run}" else [word.format(**words)])]


def serve(directory: Path, seed: int) -> None:
    """A worker: take numbers of cases from stdin, say on stdout what came of each."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ |= {"DEGLINT_MAX_PIXELS": PIXELS, "DEGLINT_INFO_SECONDS": "5"}
    from deglint.cli import run as deglint
    from detect.cli import run as rxdetect

    found = {p.name: p for p in sorted((directory / "samples").iterdir()) if p.name not in PRODUCTS}
    talk = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin:
        with tempfile.TemporaryDirectory(dir=directory) as name:
            work = Path(name)
            (work / "out").mkdir()
            os.chdir(work)
            program, *arguments = case(int(line), seed, found, work)
            sys.stdout, sys.stderr = io.StringIO(), io.StringIO()
            code = (deglint if program == "deglint" else rxdetect)([*arguments])
            said = sys.stderr.getvalue()
            if OURS in said:
                sys.stderr = io.StringIO()
                (deglint if program == "deglint" else rxdetect)([*arguments, "-vv"])
                frames = [line.strip() for line in sys.stderr.getvalue().splitlines() if line.startswith("  File")]
                said += " <- ".join(frames[:-4:-1])
            left = sorted(p.name for p in (work / "out").iterdir())
            os.chdir(directory)
        talk.write(json.dumps({"code": code, "said": said, "left": left, "peak": _peak()}) + "\n")
        talk.flush()


def _peak() -> float:
    """Most resident memory of this process [MB]."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines = status.read_text().splitlines()  # ru_maxrss would count what the parent held
    return float(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) / 1024


def verdict(came: dict) -> str:
    """What is wrong with what came of a case; nothing where all is well."""
    said, code = came["said"], came["code"]
    if came["peak"] > MOST_RESIDENT:
        return f"took {came['peak']:.0f} MB"
    if "Traceback" in said or OURS in said:
        return f"is a fault of ours: {said.strip()[-600:]}"
    if code not in (0, 1, 3):
        return f"ended with code {code}: {said[:200]}"
    if code and (not said.startswith("Error: ") or said.count("\n") != 1) and "scenes:" not in said:
        return f"does not say why in one line: {said[:300]!r}"
    if any(name.startswith(".") for name in came["left"]) or (code and came["left"]):
        return f"leaves {came['left']}"
    return ""


@dataclass
class Tried:
    """What came of a run."""

    inputs: int
    done: int
    refused: int
    findings: list[str]


def fuzz(directory: Path, cases: int, seed: int = 1, first: int = 0) -> Tried:
    """Try some cases."""
    (directory / "samples").mkdir(exist_ok=True)
    samples(directory / "samples")
    tried = Tried(0, 0, 0, [])
    worker = _start(directory, seed)
    try:
        for number in range(first, first + cases):
            worker.stdin.write(f"{number}\n")
            worker.stdin.flush()
            wrong = ""
            if not select.select([worker.stdout], [], [], PATIENCE)[0]:
                wrong = f"takes more than {PATIENCE:.0f} s"
            elif line := worker.stdout.readline():
                came = json.loads(line)
                wrong = verdict(came)
                tried.done += came["code"] == 0
                tried.refused += came["code"] != 0
            else:
                wrong = f"ended the process with {worker.wait()}"
            if wrong:
                tried.findings.append(f"case {number} of seed {seed} {wrong}")
                _stop(worker)
                worker = _start(directory, seed)
            tried.inputs += 1
    finally:
        _stop(worker)
    return tried


def _stop(worker: subprocess.Popen) -> None:
    worker.kill()
    worker.wait()
    with contextlib.suppress(BrokenPipeError):
        worker.stdin.close()
    worker.stdout.close()


def _start(directory: Path, seed: int) -> subprocess.Popen:
    call = [sys.executable, "-W", "ignore", str(Path(__file__)), "--serve", str(directory), "--seed", str(seed)]
    return subprocess.Popen(call, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                            text=True, env=os.environ | {"PYTHONPATH": str(ROOT)})  # fmt: skip


def main() -> int:
    """Fuzz, or show one case."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument(
        "--keep", type=Path, help="write the case --first into this directory, and its command on stdout"
    )
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve(given.serve, given.seed)
        return 0
    if given.keep:
        for name in ("samples", "out"):
            (given.keep / name).mkdir(parents=True, exist_ok=True)
        print(*case(given.first, given.seed, samples(given.keep / "samples"), given.keep))  # noqa: T201
        return 0
    with tempfile.TemporaryDirectory() as name:
        tried = fuzz(Path(name), given.cases, given.seed, given.first)
    print(f"{tried.inputs} inputs: {tried.done} done, {tried.refused} refused, {len(tried.findings)} found wanting")  # noqa: T201
    for finding in tried.findings:
        print(finding)  # noqa: T201
    return 1 if tried.findings else 0


if __name__ == "__main__":
    sys.exit(main())
