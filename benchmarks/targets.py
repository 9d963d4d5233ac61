"""Do small bright things survive? Targets put into scenes before the optics blur them, and ships of real scenes.

A target is opaque and flat: ``L' = L (1 - p) + p R E / pi``, p its outline through the sensor's optics, with new noise.
It survives where 80 to 125 % of its contrast is left: the excess over the scene without it, weighted by the excess it
should have, over the visible bands and the pixels that have at least a quarter of its strongest, in units of the light.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from deglint import open_scene, remove
from deglint.compensate import protect
from deglint.compensate.reference import fit_reference, reference
from deglint.masks.sample import deep_water, fit_sample
from deglint.masks.surface import Roles, fit_water, water
from deglint.physics.presets import preset
from deglint.physics.sensor import mtf
from deglint.scene import Band
from deglint.simulate import Setup, simulate, thesis_array
from deglint.simulate.light import light

from .error import DATA, DEEP, VISIBLE, rms_error
from .opening import chain, noise_model
from .timing import machine, say

Array = npt.NDArray[np.float64]
Curve = Callable[[Array], Array]
Kind = tuple[str, int]

SENSOR = preset("thesis")
SCALE = np.array([SENSOR.scale(b) for b in SENSOR.bands])[:, None, None]
STEP, SIDE, SIZES = 24, 33, (1, 2, 3, 5)
BANDS = [Band(b.name, wavelength=b.wavelength, width=b.width, time_offset=b.time_offset) for b in SENSOR.bands]


def _falls(at: float, softness: float = 15.0) -> Curve:
    return lambda w: 1 / (1 + np.exp((w - at) / softness))


COLOURS: dict[str, Curve] = {
    "white 70 %": lambda w: 0.70 + 0 * w,
    "white 30 %": lambda w: 0.30 + 0 * w,
    "white 10 %": lambda w: 0.10 + 0 * w,
    "grey 5 %": lambda w: 0.05 + 0 * w,
    "dark": lambda w: 0.005 + 0 * w,
    "red": lambda w: 0.48 - 0.45 * _falls(600, 12)(w),
    "blue": lambda w: 0.03 + 0.35 * _falls(510)(w),
    "blue dye": lambda w: 0.43 + 0.35 * _falls(510)(w) - 0.4 * _falls(740)(w),
}
"""Reflectance by wavelength [nm]; "blue dye" is bright in the near infrared, as many dyes are."""
REFLECTANCE = {k: np.array([f(np.arange(b.low, b.high + 1)).mean() for b in SENSOR.bands]) for k, f in COLOURS.items()}


@dataclass(frozen=True)
class Target:
    """What stands where."""

    colour: str
    size: int
    row: int
    column: int


@dataclass(frozen=True)
class Sea:
    """A scene in digital numbers with its truth, (band, row, column), and where the squares under water are."""

    image: Array
    truth: Array
    glint: Array
    objects: npt.NDArray[Any]


@cache
def white() -> Array:
    """Digital numbers of a white thing."""
    lit = light(Setup(sensor=SENSOR))
    return np.asarray((lit.direct + lit.diffuse) / np.pi / SCALE.ravel())


@cache
def outline(size: int, down: float, right: float, speed: float) -> Array:
    """Share of each pixel that a square takes, through the optics, (band, SIDE, SIDE); speed to the right [m/s]."""
    fine = np.fft.fftfreq(SIDE * 8, 1 / 8)
    out, middle = [], 0.0 if size % 2 else 0.5
    for band in SENSOR.bands:
        moved = right + speed * band.time_offset / SENSOR.gsd
        spectrum = mtf(fine[:, None], fine[None], SENSOR, band.wavelength) * np.outer(
            np.sinc(size * fine), np.sinc(size * fine)
        )
        spectrum = spectrum * np.exp(-2j * np.pi * np.add.outer(fine * (down + middle), fine * (moved + middle)))
        out.append(np.fft.fftshift((np.fft.ifft2(spectrum * size**2).real * 64)[::8, ::8]))
    return np.clip(np.stack(out), 0, 1)


def implant(
    sea: Sea, kinds: Sequence[Kind], seed: int, speed: float = 0.0, step: int = STEP
) -> tuple[Sea, list[Target]]:
    """The scene with targets on a grid, every second seed off the grid of the pixels; not over the squares."""
    rng, image, truth = np.random.default_rng(seed), sea.image.copy(), sea.truth.copy()
    taken = cv2.dilate((sea.objects > 0).astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    half, found, queue, steep = SIDE // 2, [], [], noise_model(SENSOR)[0]
    for row in range(20, image.shape[1] - 20, step):
        for column in range(20, image.shape[2] - 20, step):
            if taken[row, column]:
                continue
            queue = queue or [kinds[i] for i in rng.permutation(len(kinds))]
            colour, size = queue.pop()
            down, right = (rng.integers(-2, 3, 2) / 4).tolist() if seed % 2 else (0.0, 0.0)
            part = outline(size, down, right, speed)
            place = slice(None), slice(row - half, row + half + 1), slice(column - half, column + half + 1)
            own = (REFLECTANCE[colour] * white())[:, None, None]
            clean = (sea.truth[place] + sea.glint[place]) * (1 - part) + part * own
            noisy = clean + np.sqrt(steep[0] + steep[1] * clean) * rng.standard_normal(clean.shape)
            image[place] = np.where(part > 2e-3, np.clip(np.rint(noisy), 0, SENSOR.levels), image[place])
            truth[place] = truth[place] * (1 - part) + part * own
            found.append(Target(colour, size, row, column))
    return Sea(image, truth, sea.glint, sea.objects), found


def contrast(clean: Array, without: Array, truth: Array, targets: Sequence[Target]) -> Array:
    """Share of each target's contrast that is left."""
    out = []
    for t in targets:
        place = slice(VISIBLE), slice(t.row - 5, t.row + 7), slice(t.column - 5, t.column + 7)
        lit = white()[:VISIBLE, None, None]
        wanted, is_left = (truth[place] - without[place]) / lit, (clean[place] - without[place]) / lit
        counts = np.abs(wanted) > 0.25 * np.abs(wanted).max()
        out.append((is_left * wanted)[counts].sum() / (wanted[counts] ** 2).sum())
    return np.array(out)


def shared(name: str) -> Sea:
    """A scene that lies beside the project."""
    parts = [
        open_scene(DATA / "simulated" / f"{name}{e}.tif").read().astype(np.float64) for e in ("", "_truth", "_glint")
    ]
    objects = open_scene(DATA / "simulated" / f"{name}_objects.tif").read()[0]
    image, truth, glint = (p / SCALE for p in parts)
    return Sea(np.rint(image), truth, glint, objects)


def simulated(wind: float, patch: float, seed: int) -> Sea:
    """A scene made here."""
    things = thesis_array((384, 384), SENSOR.gsd)
    scene = simulate(
        Setup(sensor=SENSOR, size=(384, 384), wind=wind, patch=patch, seed=seed, objects=things), workers=2
    )
    return Sea(scene.image.astype(float), scene.truth / SCALE, scene.glint / SCALE, scene.objects)


def protected(image: Array, given: bool) -> tuple[Array, Array, protect.Things, protect.Protection]:
    """Chain alone, chain with things put back, the things, the rule; the light given or measured by the glint."""
    plain, level = chain(image, SENSOR, VISIBLE, slice(DEEP))
    lit = protect.daylight(BANDS, 40.0) / SCALE.ravel() if given else None
    rule = protect.fit([(image, level)], BANDS, noise=noise_model(SENSOR), irradiance=lit)
    found = protect.things(image, level, rule)
    return plain, protect.put_back(plain, level, found), found, rule


def groups(quick: bool) -> Iterator[tuple[str, list[Sea]]]:
    """Scenes of a kind: name, and the seas."""
    if (DATA / "simulated").exists():
        for name in ("wind05_delay60", "wind09_delay60"):
            yield name, [shared(name)]
    for patch in (0.005, 0.06):
        for wind in (5.0, 9.0):
            yield (
                f"simulated, {wind:g} m/s, patch {patch:g}",
                [simulated(wind, patch, s) for s in range(101, 102 if quick else 104)],
            )


def _survive(shares: Array) -> float:
    return float(((shares >= 0.8) & (shares <= 1.25)).mean())


def survivors(quick: bool) -> None:
    """Error without targets, and share of targets that survive."""
    kinds = [(c, s) for c in COLOURS for s in SIZES]
    errors, rows = [], []
    for name, seas in groups(quick):
        left: dict[str, dict[tuple[str, bool], list[float]]] = defaultdict(lambda: defaultdict(list))
        before, after, marked, sums = [], [], 0, []
        for sea in seas:
            plain, kept, found, rule = protected(sea.image, given=True)
            marked += int(found.mask.sum())
            sums.append(rule.threshold)
            before.append([rms_error(plain, sea.truth, c) for c in (slice(DEEP), slice(None))])
            after.append([rms_error(kept, sea.truth, c) for c in (slice(DEEP), slice(None))])
            for seed in range(2 if quick else 4):
                there, targets = implant(sea, kinds, seed)
                plain, kept, *_ = protected(there.image, given=True)
                measured = protected(there.image, given=False)[1]
                results = {"raw": there.image, "chain": plain, "protected": kept, "light measured": measured}
                for label, image in results.items():
                    for t, share in zip(targets, contrast(image, sea.truth, there.truth, targets), strict=True):
                        left[label][t.colour, t.size > 1].append(share)
        (deep, whole), (deep2, whole2) = np.mean(before, axis=0), np.mean(after, axis=0)
        mean_sum = f"{np.mean(sums):.0f}"
        errors.append([name, f"{deep:.2f} / {whole:.2f}", f"{deep2:.2f} / {whole2:.2f}", marked, mean_sum])
        for label, shares in left.items():
            cells = [
                f"{_survive(np.array(shares[c, True])):.2f} / {_survive(np.array(shares[c, False])):.2f}"
                for c in COLOURS
            ]
            rows.append([name, label, *cells])
    note = "Deep water / whole crop, in percent of the water level; pixels kept where there is no target; threshold."
    say("Error without targets [%]", ("", "chain", "protected", "kept pixels", "threshold"), errors, note)
    note = "Share that keeps 80 to 125 % of its contrast: targets of 2, 3 and 5 pixels / of 1 pixel."
    say("Targets that survive", ("", "", *COLOURS), rows, note)


def moving(quick: bool) -> None:
    """Targets that move while the bands look one after the other."""
    rows, kinds = [], [("white 30 %", 2), ("white 30 %", 3), ("white 30 %", 5)]
    for name, seas in groups(True):
        for speed in (0.5, 1.0, 2.0) if quick else (0.25, 0.5, 1.0, 2.0, 4.0):
            there, targets = implant(seas[0], kinds, 1, speed, 2 * STEP)
            shares = contrast(protected(there.image, given=True)[1], seas[0].truth, there.truth, targets)
            cells = [
                f"{_survive(np.array([x for t, x in zip(targets, shares, strict=True) if t.size == s])):.2f}"
                for s in (2, 3, 5)
            ]
            rows.append([name, f"{speed:g}", *cells])
    say("White (30 %) targets that move and survive", ("", "m/s", "2 pixels", "3", "5"), rows)


@dataclass(frozen=True)
class Ships:
    """Share of contrast left, (ship, band), and noise of deep water (band,), for B02, B03, B04."""

    plain: Array
    protected: Array
    unmasked: Array
    noise: Array
    plain_noise: Array
    replaced: int


def ships(name: str) -> Ships:
    """Labelled ships, of whose ring at least a third is water, before and after Hedley (detrended slopes)."""
    image = open_scene(DATA / "sentinel2" / f"{name}.tif").read().astype(np.float64)
    labels = open_scene(DATA / "sentinel2" / f"{name}_ships.tif").read()[0].astype(int)
    sea = water(image, rule := fit_water([image], Roles(nir=3, blue=0, green=1, red=2)))
    deep = deep_water(image, fit_sample([image], rule))
    model = remove.fit("hedley", image, nir=3, sample=deep, regression="detrended")
    limit = fit_reference([(image[3], deep)])
    results = [remove.apply(image, model)]
    for mask in (sea, np.ones_like(sea)):
        block = image.copy()
        block[3] = reference(image[3], mask, limit)
        results.append(remove.apply(block, model))
    shares = [[_ship_contrast(i, labels, sea, n) for i in (image, *results)] for n in range(1, labels.max() + 1)]
    whole = np.array([s for s in shares if s[0] is not None], np.float64)
    plain, kept, unmasked = (whole[:, k] / whole[:, 0] for k in (1, 2, 3))
    changed = reference(image[3], sea, limit) != image[3]
    noises = [_noise(r, deep & ~changed) for r in results]
    return Ships(plain, kept, unmasked, noises[1], noises[0], int((changed & deep).sum()))


def _ship_contrast(image: Array, labels: npt.NDArray[Any], sea: npt.NDArray[np.bool_], number: int) -> Array | None:
    """Brightest pixel of the ship against the median of the water 5 to 15 pixels from it."""
    rows, columns = np.nonzero(labels == number)
    if not rows.size:
        return None
    out = []
    for band in image[:3]:
        at = int(np.argmax(band[rows, columns]))
        y, x = np.ogrid[: labels.shape[0], : labels.shape[1]]
        away = np.hypot(y - rows[at], x - columns[at])
        ring = (away >= 5) & (away <= 15) & (labels != number)
        if 3 * (sea & ring).sum() < ring.sum():
            return None
        out.append(band[rows, columns].max() - np.median(band[ring & sea]))
    return np.array(out)


def _noise(image: Array, deep: npt.NDArray[np.bool_]) -> Array:
    """Standard deviation of deep water, where nothing stands out, about its mean over 31 x 31 pixels."""

    def box(values: Array) -> Array:
        return cv2.boxFilter(values, -1, (31, 31), normalize=False, borderType=cv2.BORDER_CONSTANT)

    count = np.maximum(box(deep.astype(np.float64)), 1)
    return np.array([(b - box(np.where(deep, b, 0.0).astype(np.float64)) / count)[deep].std() for b in image[:3]])


def real() -> None:
    """Ships of two harbours."""
    rows = []
    for name in ("casablanca", "honolulu"):
        s = ships(name)
        cases = (
            ("hedley", s.plain, s.plain_noise),
            ("protected", s.protected, s.noise),
            ("no water mask", s.unmasked, ()),
        )
        for label, left, noise in cases:
            text = [f"{np.median(left[:, b]):.2f} / {(left[:, b] >= 0.8).mean():.2f}" for b in range(3)]
            rows.append(
                [f"{name}, {len(left)} ships", label, *text, *(f"{x:.1f}" for x in noise), *[""] * (3 - len(noise))]
            )
    note = "Median share of contrast left / share of ships that keep 80 %; noise of deep water [DN]."
    say("Ships", ("", "", "B02", "B03", "B04", "noise B02", "B03", "B04"), rows, note)


def real_targets() -> None:
    """Grey squares put straight into the water of real scenes, over whatever waves are there."""
    rows = []
    for name, unit, nir in (("casablanca", 65535.0, 3), ("honolulu", 65535.0, 3), ("palau", 1e4, 7)):
        image = open_scene(DATA / "sentinel2" / f"{name}.tif").read().astype(np.float64)
        visible = (0, 1, 2) if nir == 3 else (1, 2, 3)
        roles = Roles(nir=nir, blue=visible[0], green=visible[1], red=visible[2])
        sea = fit_mask(image, roles)
        deep = deep_water(image, fit_sample([image], fit_water([image], roles)))
        model = remove.fit("hedley", image, nir=nir, sample=deep, regression="detrended")
        clean = remove.apply(image, model)
        limit = fit_reference([(image[nir], deep)])
        for reflectance in (0.05, 0.1, 0.3):
            there, places = image.copy(), []
            for row in range(20, image.shape[1] - 20, STEP):
                for column in range(20, image.shape[2] - 20, STEP):
                    if sea[row - 8 : row + 9, column - 8 : column + 9].all():
                        size = SIZES[len(places) % 4]
                        places.append((slice(row, row + size), slice(column, column + size)))
                        there[(slice(None), *places[-1])] = reflectance * unit
            cells = []
            block = there.copy()
            block[nir] = reference(there[nir], fit_mask(there, roles), limit)
            for cleaned in (remove.apply(there, model), remove.apply(block, model)):
                shares = [[(cleaned[b][p] - clean[b][p]).mean() / (there[b][p] - image[b][p]).mean() for b in visible]
                          for p in places]  # fmt: skip
                cells.append(f"{np.median(shares):.2f} / {_survive(np.array(shares).ravel()):.2f}")
            rows.append([name, f"{100 * reflectance:g} %", str(len(places)), *cells])
    note = "Median share of contrast left / share that keeps 80 to 125 %, over B02, B03, B04."
    say("Targets of 1 to 5 pixels in real water", ("", "reflectance", "targets", "hedley", "protected"), rows, note)


def fit_mask(image: Array, roles: Roles) -> npt.NDArray[np.bool_]:
    """Water, found with the targets there."""
    return water(image, fit_water([image], roles))


def main(quick: bool) -> None:
    """Measure and print."""
    print("## Small things\n\n" + machine())
    survivors(quick)
    moving(quick)
    if (DATA / "sentinel2" / "casablanca.tif").exists():
        real()
        real_targets()
