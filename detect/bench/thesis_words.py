"""What the errors against wind and delay show, in words; every figure is computed."""

from __future__ import annotations

from . import simulated
from .thesis_measure import CHAINS, Found, Key

NAMES = {"raw": "nothing", "hedley": "Hedley", "lyzenga": "Lyzenga", "joyce": "Joyce", "multiband": "multiband",
         "auto": "--method auto"}  # fmt: skip


def opening(found: Found, seeds: int) -> tuple[str, ...]:
    """What was done, and how it is measured."""
    side, pixels = simulated.SIDE, simulated.PIXELS
    made = (
        f"Simulated scenes of {side} x {side} pixels of 25 cm in eight bands, {seeds} of each kind: deep water on the "
        f"left, objects of {pixels} x {pixels} pixels at {simulated.DEPTH:g} m on the right; sun at 40 degrees, seen "
        f"from above, f/10, half a pixel of smear, 12 bits. Winds of {_spoken(found.winds)} m/s; band after band looks "
        f"{_spoken([1000 * d for d in found.delays])} ms later. One sea serves all delays of a seed."
    )
    noise = _range(found, "noise", "alone", found.delays)
    error = (
        "Error: root mean square over COASTAL to RED of the RMSE against the scene without glint and noise, over the "
        f"median of that, in percent. Noise alone makes {noise} %: what removal would leave that took all glint and "
        "nothing else. Stages that put the water beside in a pixel's place take its noise, too, and may end a little "
        "lower. The sample is the deep water, given to every method; 'alone' is --compensate off. Raw with "
        "compensation is what the stages before a removal do by themselves."
    )
    sky = (
        f"The sky is {simulated.SKY}. Under a sky that is brighter around the sun the truth itself holds mirrored sky, "
        "which nothing tells from glint: errors would then be larger for every method, by what it takes away of that."
    )
    return made, error, sky


def finding(found: Found) -> str:
    """The chapter in two sentences."""
    wind, still, late = found.shown, min(found.delays), max(found.delays)
    alone, kept, raw = (_value(found, wind, late, m, c) for m, c in
                        (("joyce", "alone"), ("auto", "compensated"), ("raw", "alone")))  # fmt: skip
    if None in (alone, kept, raw):
        return ""
    before = _value(found, wind, still, "joyce", "alone")
    return (
        f"At {wind:g} m/s with {1000 * late:g} ms from band to band, glint makes an error of {raw} % of the water level"
        f"; Joyce alone leaves {alone} % (bands at one instant: {before} %), the defaults leave {kept} %."
    )


def of_method(found: Found, method: str) -> tuple[str, ...]:
    """What the figures of a method show, and where it hurts."""
    shows = [_shows(found, method), *([] if method == "raw" else [_hurts(found, method)]), _chains(found, method)]
    return tuple(shows + [_protected(found)] * (method == "auto"))


def _shows(found: Found, method: str) -> str:
    wind, still, late = found.shown, (min(found.delays),), (max(found.delays),)
    over = f"from {min(found.winds):g} to {max(found.winds):g} m/s"
    if method == "raw":
        return (
            f"Nothing done leaves {_range(found, 'raw', 'alone', still)} % {over} where all bands look at one instant, "
            f"and {_range(found, 'raw', 'alone', late)} % at {1000 * late[0]:g} ms: the delay moves glint from band to "
            "band and adds none. Compensation without a removal leaves "
            f"{_range(found, 'raw', 'thesis-chain', late)} % (the thesis' chain) and "
            f"{_range(found, 'raw', 'compensated', late)} % (--compensate auto) at {1000 * late[0]:g} ms."
        )
    text = (
        f"Over winds {over}, {NAMES[method]} alone leaves {_range(found, method, 'alone', still)} % where all bands "
        f"look at one instant, and {_range(found, method, 'alone', late)} % at {1000 * late[0]:g} ms. "
    )
    shares = [_share(found, (wind, d, method, "alone"), (wind, d, "raw", "alone")) for d in found.delays]
    if None not in shares:
        by_delay = ", ".join(f"{s} at {1000 * d:g} ms" for s, d in zip(shares, found.delays, strict=True))
        text += f"At {wind:g} m/s that is, of the error of the untouched scene: {by_delay}. "
    after = [_range(found, method, c, late) for c in ("thesis-chain", "compensated")]
    return text + (
        f"At {1000 * late[0]:g} ms it leaves {after[0]} % after the thesis' chain and {after[1]} % with "
        "--compensate auto."
    )


def _hurts(found: Found, method: str) -> str:
    """Where the method is worse than nothing, beyond the interval of the paired difference."""
    parts = []
    for chain, said in zip(CHAINS, ("alone", "after the thesis' chain", "with --compensate auto"), strict=True):
        pairs = [((w, d, method, chain), (w, d, "raw", "alone")) for d in found.delays for w in found.winds]
        worse = _worse(found, pairs)
        if worse:
            parts.append(f"{said}: {worse}")
    if not parts:
        return f"Nowhere is it worse than nothing beyond the 95 % interval of the difference{_caution(found)}."
    return "It hurts (worse than nothing, beyond the 95 % interval of the difference) " + "; ".join(parts) + "."


def _chains(found: Found, method: str) -> str:
    """Where compensation makes a method worse."""
    parts = []
    for chain, said in (("thesis-chain", "The thesis' chain"), ("compensated", "--compensate auto")):
        pairs = [((w, d, method, chain), (w, d, method, "alone")) for d in found.delays for w in found.winds]
        worse = _worse(found, pairs)
        parts.append(
            f"{said} makes it worse {worse}." if worse else f"{said} makes it worse nowhere beyond the interval."
        )
    return " ".join(parts)


def _protected(found: Found) -> str:
    """What the protection of small things costs where there are none."""
    rise = {}
    for delay in found.delays:
        for wind in found.winds:
            more = found.more((wind, delay, "auto", "compensated"), (wind, delay, "auto", "unprotected"))
            if more is not None:
                rise[wind, delay] = more.value
    if not rise or max(rise.values()) <= 0:
        return "Protection of small things changes nothing here."
    wind, delay = max(rise, key=lambda k: rise[k])
    kept, without = (_value(found, wind, delay, "auto", chain) for chain in ("compensated", "unprotected"))
    count = sum(r > 1 for r in rise.values())
    return (
        "Small things that stand out unlike glint are kept as they are. These scenes hold none, so that what is kept "
        f"in open water is glint: it adds more than 1 % of error in {count} of {len(rise)} combinations of wind and "
        f"delay, most at {1000 * delay:g} ms and {wind:g} m/s, where {without} % becomes {kept} %."
    )


def _worse(found: Found, pairs: list[tuple[Key, Key]]) -> str:
    """Conditions where the first is worse than the second beyond the interval, and the worst of them."""
    by_delay: dict[float, list[float]] = {}
    worst: tuple[float, Key, Key] | None = None
    for one, other in pairs:
        more = found.more(one, other)
        if more is None or not more.low > 0:
            continue
        by_delay.setdefault(one[1], []).append(one[0])
        if worst is None or more.value > worst[0]:
            worst = more.value, one, other
    if worst is None:
        return ""
    where = ", ".join(f"at {1000 * d:g} ms and {_spoken(winds)} m/s" for d, winds in by_delay.items())
    _, one, other = worst
    before, after, deep_before, deep_after = (
        _value(found, *key, what) for what in ("whole", "deep") for key in (other, one)
    )
    return (
        f"{where} (most at {1000 * one[1]:g} ms and {one[0]:g} m/s: {before} % becomes {after} %; in deep water, where "
        f"there are no objects, {deep_before} % becomes {deep_after} %)"
    )


def _caution(found: Found) -> str:
    count = min((len(v) for v in found.errors.values()), default=0)
    return "" if count > 2 else f", which from {count} seed{'s' * (count > 1)} is wide" if count > 1 else (
        ", which one seed cannot tell")  # fmt: skip


def _range(found: Found, method: str, chain: str, delays: tuple[float, ...]) -> str:
    """Least and greatest mean error over winds and some delays."""
    means = [n.value for d in delays for w in found.winds if (n := found.mean(w, d, method, chain)) is not None]
    if not means:
        return "(not fitted)"
    low, high = f"{min(means):.3g}", f"{max(means):.3g}"
    return low if low == high else f"{low} to {high}"


def _value(found: Found, wind: float, delay: float, method: str, chain: str, what: str = "whole") -> str | None:
    number = found.mean(wind, delay, method, chain, what)
    return None if number is None else f"{number.value:.3g}"


def _share(found: Found, one: Key, other: Key) -> str | None:
    a, b = found.mean(*one), found.mean(*other)
    return None if a is None or b is None else f"{100 * a.value / b.value:.3g} %"


def _spoken(values: tuple[float, ...] | list[float]) -> str:
    """Numbers in a row: 2, 5 and 9."""
    words = [f"{v:g}" for v in values]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
