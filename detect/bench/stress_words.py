"""What the stress shows, in words: every figure in them comes from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

from .stress_rates import ByCase

Rows = Mapping[str, Mapping[str, float | str]]
SINGLE = 6.5
"""Digits below which a result is worse than single precision holds."""
EXPLAINED = {
    "denormal float32": "the corrected pixels are denormal float32, which hold so few digits",
    "collinear but for 1e-5": "a covariance loses as many digits as its condition number has",
    "one pixel of 1e6": "the stray pixel makes the bands collinear, and a covariance loses as many digits",
    "one NIR pixel of 1e15": "the regression is not made for a stray pixel in the NIR",
    "denormal float64": "the mean itself is a denormal number",
    "int64, offset 1e18": "pixels become float64, which does not hold integers beyond 2^53",
}
"""Why few digits can be had there."""
ITERATED, STORED = "slope, Huber", "correction, as stored"
SINGLE_OUTPUT = ("correction", "RX", "local RX")
"""Given as float32 where pixels are of another type than float64 (corrections: of float32)."""


NOT_FINITE = ("1 % NaN", "1 % infinity")


def paragraphs(
    found: Mapping[str, Rows], rates: ByCase, thresholds: Mapping[str, Mapping[str, float]], missing: Sequence[str],
    double: Set[str],
) -> tuple[str, ...]:  # fmt: skip
    """Paragraphs for the report; `double` names the blocks of float64."""
    ours = found["deglint"]
    return (
        _done(ours),
        _kept(ours, double),
        _lost(ours),
        *(text for program, rows in found.items() if program != "deglint" and (text := _peer(program, rows, ours))),
        _areas(rates, thresholds),
        *([" ".join(missing)] if missing else []),
    )


def finding(found: Mapping[str, Rows]) -> str:
    """For the head of the report: how often others lose the digits that float32 holds, of what both compute."""
    parts, ours = [], found["deglint"]
    for program, rows in found.items():
        pairs = [(ours.get(operation, {}).get(name), b) for operation, row in rows.items() for name, b in row.items()]
        both = [(a, b) for a, b in pairs if isinstance(a, float) and isinstance(b, float)]
        lost = [sum(pair[i] < SINGLE for pair in both) for i in (0, 1)]
        if program != "deglint" and both:
            parts.append(f"{program} {lost[1]} of {len(both)} (deglint {lost[0]})")
    if not parts:
        return ""
    return f"Results on hard pixels with fewer digits than float32 holds, of what both compute: {', '.join(parts)}."


def _values(row: Mapping[str, float | str]) -> dict[str, float]:
    return {name: v for name, v in row.items() if isinstance(v, float)}


def _done(ours: Rows) -> str:
    blocks = {name for row in ours.values() for name in row}
    return (
        f"{len(ours)} operations were tried on {len(blocks)} blocks of pixels, each hard in one way, and compared with "
        "long double computed in another way. Digits are those of the worst value; 16 is all that float64 holds."
    )


def _kept(ours: Rows, double: Set[str]) -> str:
    """What keeps its digits everywhere but where that cannot be."""
    parts, single = [], []
    for operation, row in ours.items():
        fair = {n: v for n, v in _values(row).items() if n not in EXPLAINED and operation not in (ITERATED, STORED)}
        narrow = {n: v for n, v in fair.items() if n not in double}
        if narrow and operation in SINGLE_OUTPUT:
            single.append(f"{operation} {min(narrow.values()):.1f}")
            fair = {n: v for n, v in fair.items() if n in double}
        if fair:
            name = min(fair, key=lambda n: fair[n])
            parts.append(f"{operation} {fair[name]:.1f} ({name})")
    huber, stored = _values(ours[ITERATED]), _values(ours[STORED])
    return (
        "The fewest digits of deglint, leaving aside the blocks of the next paragraph: " + "; ".join(parts) + ". "
        f"What is given as float32, which holds 7, has {', '.join(single)}. Huber's regression iterates until its "
        f"gradient is below 1e-8: {huber['plain']:.1f} digits of plain pixels. Pixels corrected to whole numbers are "
        f"off by half of one: {min(stored.values()):.1f} digits."
    )


def _lost(ours: Rows) -> str:
    """Where few digits can be had."""
    parts = []
    for name, why in EXPLAINED.items():
        few = {
            o: v
            for o, row in ours.items()
            if (v := _values(row).get(name, 16.0)) < SINGLE and o not in (ITERATED, STORED)
        }
        none = [o for o, row in ours.items() if isinstance(row.get(name), str)]
        said = [f"{o} {v:.1f}" for o, v in few.items()] + [f"{o} refused" for o in none]
        if said:
            parts.append(f"{name}: {', '.join(said)} ({why})")
    return "Fewer digits than float32 holds are left in: " + "; ".join(parts) + "." if parts else ""


def _peer(program: str, rows: Rows, ours: Rows) -> str:
    """The worst of a peer, and how it stands beside ours."""
    pairs = [
        (operation, name, mine, theirs)
        for operation, row in rows.items()
        for name, theirs in row.items()
        if (mine := ours.get(operation, {}).get(name)) is not None
    ]
    both = [(o, n, a, b) for o, n, a, b in pairs if isinstance(a, float) and isinstance(b, float)]
    if not both:
        return ""
    wrong = sum(b == 0 < a for _, n, a, b in both if n in NOT_FINITE)
    worse = [(o, n, a, b) for o, n, a, b in both if b < SINGLE and a >= b + 1 and n not in NOT_FINITE]
    better = [(o, n, a, b) for o, n, a, b in both if b > a + 1]
    level = sum(abs(a - b) <= 1 for _, _, a, b in both)
    refused = sum(isinstance(b, str) and isinstance(a, float) for _, _, a, b in pairs)
    text = f"{program}: of {len(pairs)} results {level} have as many digits as deglint's, to one digit"
    text += f", and {refused} stopped with an error where deglint answers. " if refused else ". "
    if wrong:
        text += f"{wrong} are NaN or wrong because of pixels that are not finite. "
    if worse:
        o, n, a, b = max(worse, key=lambda x: x[2] - x[3])
        text += (
            f"{len(worse)} more have fewer digits than float32 holds where deglint has them; the furthest behind is "
            f"{o} of {n}, {b:.1f} digits against {a:.1f}. "
        )
    if better:
        o, n, a, b = max(better, key=lambda x: x[3] - x[2])
        text += f"deglint has fewer in {len(better)}, most so in {o} of {n}: {a:.1f} against {b:.1f}."
    return text.strip()


def _areas(rates: ByCase, thresholds: Mapping[str, Mapping[str, float]]) -> str:
    def least(program: str) -> str:
        found = [(v, o, name) for (name, _), p in rates.items() for o, v in p[program].items()]
        value, operation, name = min(found)
        return f"{value:.1f} ({operation}, {name})"

    text = (
        "Areas under the ROC curve and what DeLong makes of them are counted in whole numbers: the fewest digits are "
        f"{least('deglint')} by deglint and {least('scikit-learn')} by scikit-learn, which has no DeLong. "
    )
    for program, worst in thresholds.items():
        text += f"Thresholds and p-values by {program}: " + ", ".join(f"{o} {v:.1f}" for o, v in worst.items()) + ". "
    return text.strip()
