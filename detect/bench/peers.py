"""Speed and memory beside other programs, in one run and in turns; and how they grow."""

from __future__ import annotations

import tempfile
from pathlib import Path

from . import kernels, peers_arrays, peers_files, peers_growth
from .arrays import OURS, SKLEARN, SPECTRAL
from .peers_files import COPY, NUMPY, REMOVE, SCORE, SENSINGPY, SLUGS, Case
from .section import Effort, Number, Section

WORDS = (
    "Whole processes from the start of the interpreter to its end, and functions on arrays in memory, all in turns and "
    "each measured alone. What every program must at least do is the floor: a block copy for what writes all bands, "
    "reading twice and writing one band for what fits and then scores. Scenes are synthetic and seeded."
)


def run(effort: Effort) -> Section:
    """Everything beside everything."""
    python, sensingpy = peers_files.interpreter(effort.peers)
    others, _ = peers_arrays.installed()
    cases = [(Case(1024), 2)] if effort.quick else [(Case(4096), 5), (Case(2048, "uint16", "deflate"), 3)]
    with tempfile.TemporaryDirectory(dir=effort.directory) as name:
        place = Path(name)
        files, known = [], {}
        for case, rounds in cases:
            section, found = peers_files.beside(case, effort, rounds, python, place)
            files.append(section)
            if case == Case(case.side):
                known[case.side] = found
        arrays = peers_arrays.run(effort)
        growth = (
            peers_growth.sizes(effort, place, known),
            peers_growth.bands(effort, place, others),
            peers_growth.threads(effort, place),
            peers_growth.windows(effort, others),
        )
    parts = (
        Section("peers/files", "From file to file", (_about_sensingpy(python, sensingpy),),
                tuple(t for s in files for t in s.tables), (), _numbers(*files)),
        peers_files.start_up(effort),
        arrays,
        kernels.run(effort),
        *growth,
    )  # fmt: skip
    numbers = _numbers(*parts)
    words = (
        WORDS,
        *said(numbers, cases[0][0]),
    )
    return Section("peers", "Beside other programs", words, parts=parts, finding=finding(numbers, cases[0][0]))


def _numbers(*sections: Section) -> dict[str, Number]:
    return {name: number for one in sections for name, number in one.every_number().items()}


def _about_sensingpy(python: str, version: str) -> str:
    if not python:
        return version
    return f"sensingpy {version} is run as its documentation has it, with the whole scene in memory."


def said(numbers: dict[str, Number], case: Case) -> tuple[str, ...]:
    """What the figures show, in words; what was not measured is not spoken of."""
    stem = f"peers/files/{case.slug}"
    lines = []
    for name in (REMOVE, SCORE, NUMPY, SENSINGPY):
        ratio, peak = (numbers.get(f"{stem}/{SLUGS[name]}/{key}") for key in ("ratio", "peak"))
        if ratio is not None and peak is not None:
            lines.append(f"{name} {ratio.value:.2g} times its floor and {peak.value:.0f} MB")
    out = [f"On {case}: {'; '.join(lines)}."] if lines else []
    sides = sorted(
        int(n.split("/")[3]) for n in numbers if n.startswith("peers/growth/size/") and n.endswith("/remove/peak")
    )
    if len(sides) > 1:
        low, high = (numbers[f"peers/growth/size/{s}/remove/peak"].value for s in (sides[0], sides[-1]))
        copy = numbers.get(f"peers/growth/size/{sides[-1]}/copy/peak")
        more = f", where a block copy takes {copy.value:.0f} MB" if copy is not None else ""
        many = (sides[-1] / sides[0]) ** 2
        out.append(f"From a side of {sides[0]} to {sides[-1]} pixels, {many:.0f} times as many, the "
                   f"memory of {REMOVE} goes from {low:.0f} to {high:.0f} MB{more}.")  # fmt: skip
    return tuple(out)


def finding(numbers: dict[str, Number], case: Case) -> str:
    """For the head of the report."""
    ratio = numbers.get(f"peers/files/{case.slug}/remove/ratio")
    out = []
    if ratio is not None:
        out.append(f"On {case}, {REMOVE} takes {ratio.value:.2g} times as long as a {COPY} of the same file")
    for program in (SKLEARN, SPECTRAL):
        found = [
            n for k, n in numbers.items() if k.startswith("peers/arrays/global_8x") and k.endswith(f"/{program}/ratio")
        ]
        out += [f"{program} {found[0].value:.2g} times as long as {OURS} for global RX"] if found else []
    return "; ".join(out) + "." if out else ""
