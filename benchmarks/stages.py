"""Speed of each stage of compensation on an array in memory, on one thread; reading the array is the yardstick."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from deglint.compensate.codes import decoded, encoded
from deglint.compensate.faint import give_back
from deglint.compensate.level import Opened, blurred
from deglint.compensate.opening import openings
from deglint.compensate.presence import Presence

from deglint.compensate import Chain, Sample, Setting, State, apply_stages, fit_stages, parse, protect, system_psf
from deglint.compensate import apply as apply_chain
from deglint.compensate.identify import LEVEL_K
from deglint.compensate.noise import Spread
from deglint.compensate.sharpen import richardson_lucy
from deglint.physics.presets import preset
from deglint.scene import Band
from deglint.simulate import Setup, simulate

from .timing import in_turns, say

FORMS: dict[str, dict[str, Any]] = {
    "one product": {"rank": 1}, "two products": {}, "FIR": {"form": "fir"}, "Fourier transform": {"form": "fft"},
}  # fmt: skip


def sea(side: int) -> tuple[np.ndarray, tuple[Band, ...], Any]:
    """A simulated sea, laid side by side to the size, its bands and their PSFs."""
    sensor = preset("thesis").delayed(0.06)
    image = simulate(Setup(sensor=sensor, size=(256, 256), wind=9.0, sky="cardioidal", patch=0.06)).image
    scale = np.array([sensor.scale(b) for b in sensor.bands], np.float32)[:, None, None]
    block = np.tile(image.astype(np.float32) * scale, (1, side // 256, side // 256))
    bands = tuple(Band(b.name, b.wavelength, b.high - b.low, b.time_offset) for b in sensor.bands)
    psfs = tuple(system_psf(b.wavelength, f_number=sensor.f_number, pitch=sensor.pitch) for b in sensor.bands)
    return block, bands, psfs


def fitted(text: str, block: np.ndarray, setting: Setting) -> Chain:
    """A chain fitted to a quarter of a block."""
    part = block[:, :512, :512]
    steps = parse(text)
    stages = fit_stages(steps[:-1], Sample([State.of(part)], [np.ones(part.shape[1:], np.bool_)]), setting)
    return Chain(stages, (), text)


def sharpened(block: np.ndarray, psfs: Any, **how: Any) -> None:
    """Sharpen every band."""
    for band, psf in zip(block, psfs, strict=True):
        richardson_lucy(band, psf, iterations=2, **how)


def searching(block: np.ndarray, bands: tuple[Band, ...], chain: Chain) -> Callable[[], object]:
    """The search for small things in what a chain leaves of a block."""
    state = apply_stages(State.of(block), chain.before)
    assert state.water is not None
    sigmas = np.array(chain.before[1].sigmas)
    noise = np.stack([0.2 * sigmas**2, 0.8 * sigmas**2 / np.median(state.water, axis=(1, 2))], axis=1)
    level = state.water
    protection = protect.fit([(block, level)], bands, noise=noise)
    return lambda: protect.things(block, level, protection)


def giving_back(rng: np.random.Generator, shape: tuple[int, ...]) -> Callable[[], object]:
    """Give back half of what was taken from a calm sea: all that lies `LEVEL_K` standard deviations above it."""
    own = rng.standard_normal(shape, np.float32)
    replaced = own > LEVEL_K
    image, share = np.where(replaced, np.float32(0), own), np.zeros(shape[1:], np.float32)
    spreads, whole = [Spread(b, 1.0) for b in range(len(own))], (slice(0, shape[1]), slice(0, shape[2]))
    out = image.copy()
    return lambda: give_back(image, own, replaced, share, spreads, whole, out)


def rates(values: int, seconds: list[float]) -> str:
    """Millions of values a second, best and median, as text."""
    return f"{values / 1e6 / min(seconds):.0f} / {values / 1e6 / median(seconds):.0f}"


def main(quick: bool) -> None:
    """Measure and print."""
    import cv2

    cv2.setNumThreads(1)
    block, bands, psfs = sea(512 if quick else 1024)
    setting = Setting(bands, psfs, detail=True)
    grids = [(float(np.median(b)), float(b.std())) for b in block]
    whole = ((0, block.shape[1]), (0, block.shape[2]))
    codes = [encoded(b, *g) for b, g in zip(block, grids, strict=True)]
    out = np.empty((2, *block.shape), np.int16)

    def opened(detail: int) -> None:
        for i, band in enumerate(codes):
            openings(band, 13, detail, within=whole, out=(out[0, i], out[1, i]))

    opened(13)
    level = [decoded(c, *g) for c, g in zip(out[0], grids, strict=True)]
    order, spectrum = range(len(bands)), [1.0] * len(bands)
    chains = {text: fitted(text, block, setting) for text in (
        "identify-level:13, replace-level", "psf:2, identify-level:13, replace-level",
        "normalise, identify-median:5, replace-bands, median:25",
    )}  # fmt: skip
    jobs: dict[str, Callable[[], object]] = {
        "read once (sum of each band)": lambda: [float(b.sum()) for b in block],
        "normalise": lambda: [b / np.float32(2) for b in block],
        **{f"psf: 2 iterations, {name}": partial(sharpened, block, psfs, **how) for name, how in FORMS.items()},
        "codes of 16 bits": lambda: [encoded(b, *g) for b, g in zip(block, grids, strict=True)],
        "opening, square of 13": lambda: opened(0),
        "the same with an octagon of 13 grown back, and a diamond": lambda: opened(13),
        "outlines that neighbouring bands share": Opened(out[0], out[1], grids, spectrum, order).level,
        "level blurred again": lambda: [blurred(m, p) for m, p in zip(level, psfs, strict=True)],
    }
    presence = Presence(len(bands) - 2, *grids[-2])
    jobs["where glint is, by the NIR"] = lambda: presence.cells(block, 0, 0)
    jobs["faint pixels: half given back, where there is no glint"] = giving_back(np.random.default_rng(0), block.shape)
    jobs["search for small things"] = searching(block, bands, chains["psf:2, identify-level:13, replace-level"])
    jobs |= {f"chain: {text}": (lambda c=chain: apply_chain(block, c)) for text, chain in chains.items()}
    found = in_turns(jobs, 3 if quick else 7)
    base = min(found["read once (sum of each band)"])
    rows = [[name, rates(block.size, s), f"{min(s) / base:.1f}"] for name, s in found.items()]
    size = f"{len(block)} x {block.shape[1]}^2 float32, one thread"
    say(f"Stages, {size}", ("", "Mpx-band/s, best / median", "time, in reads of the array"), rows)
