r"""Expected error of a recipe, from the texture that it leaves in sample tiles and its gains of implanted signals.

At each scale s the result of recipe c has the power (mean square of the texture)

.. math:: P_{cs} = g_{cs}^2 S_s + N_{cs}

with S the power of the true texture of the water (the scene's own signal), the same for all recipes, g the gain of
a signal at that scale, and N the power of the glint and noise that is left. The mean square error, against the scene
without glint and noise, is then

.. math:: E_{cs} = (1 - g_{cs})^2 S_s + N_{cs} = P_{cs} + (1 - 2 g_{cs}) S_s .

S is not known, but it cannot exceed :math:`P_{cs} / g_{cs}^2` of any recipe. Where bands have different sparkle, P is
replaced in this limit by the power that two bands share, the mean product of their textures (`partners`). The minimum
of the limit over the recipes is computed twice: for all pixels, and for the pixels with the least glint. The first is
too large if all recipes leave glint. The second is too small if it excludes shallow bottoms, which look like glint in
the NIR. S is the geometric mean of both minima, or the first if that is smaller. But S is at least the power of the
texture that neither noise nor the glint in the NIR explains (`least_signal`). A recipe that erases signals has a small
P but also a small g, so its E is not small. The few tiles may lack some signals. Therefore two losses are added to E:
the loss of a weak signal at each scale but the coarsest, and the loss of objects and of plumes with typical contrasts.
Objects and plumes are each assumed on a hundredth of the scene.

At the coarsest scale only the loss :math:`(1 - g)^2 S` counts: glint that is left there shifts all pixels alike, and
texture does not show such a shift. At this scale g is the gain of plumes or, if larger, the root of the ratio of P to
the largest P of all recipes. The root is larger for a reef, which is bright in the visible but, unlike sediment, not in
the NIR. If the result of a removal is brighter than the darkest result of an opening, or the reverse, a part of the
difference is counted as glint that is left (`level_excess`): an opening is too bright where it finds no water between
the glint; a removal is too bright if even the pixels with the least glint, which determine its level, have some glint.
What an opening takes from a band beyond the glint that the NIR explains is counted as erased signal (`erased`).
"""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from ..compensate.state import LASTS, Setting
from ..moments import Float64, Mask
from .implants import BRIGHT, PLUME, SCALES, Float32

SHARE = 0.01  # assumed share of a scene that objects cover, and that plumes cover
SIGNAL = 0.05
"""Root mean square of a signal that is assumed besides S at all scales but the coarsest, relative to the water: the
weakest that an analyst sees in an image without glint. Sample tiles are few, and may lack the objects of interest."""
ZERO_GAIN = 0.05  # lower limit of a gain as a divisor: the uncertainty of a gain that is estimated from a few tiles
HALF = 0.5  # the same limit for the gain of plumes, of which there is only one in a tile
EDGES = 0.5  # assumed share of edges in the scene's own signal, the rest is texture: neither is known to prevail
GLINT_OF_NIR = 2.0
"""Largest ratio of the texture, or the mean, of glint in a band to that in the NIR, divided by the spectrum of glint.
That of texture is 0.6 to 1.3 in simulated seas, up to 1.9 at the finest scale, where bands differ in blur. For shallow
bottoms it is up to 80."""
LEAST_GLINT_PERCENT = 10.0
"""Share of the pixels that count as pixels with the least glint [%]: small, so that glint is weak; large enough (ten
thousand pixels in eight tiles) that the power of their texture is known to a few percent."""


def powers(
    images: Sequence[Float32],
    inside: Sequence[Mask],
    unit: Float32,
    clear: Sequence[Mask] = (),
    partner_of: Mapping[int, int] | None = None,
) -> Float64:
    """Power of images, (scale,): mean square of texture divided by `unit`, over all pixels and bands, at each scale.

    Texture is the local mean over `SCALES[i]` pixels minus that over `SCALES[i + 1]`, or over the tile for the last i.

    images, inside : for each tile, image (band, row, column), and mask (row, column) of the pixels to use
    unit : (band,) divisor of each band [unit of the band]; infinite for bands that are not evaluated
    clear : per tile, mask (band, scale, row, column) used instead of `inside` except at the last scale (`least_glint`)
    partner_of : partner of each band (`partners`): the textures of both are multiplied; default: the band itself
    """
    partner_of = partner_of or {int(b): int(b) for b in np.flatnonzero(np.isfinite(unit))}
    total, pixels = np.zeros(len(SCALES)), np.zeros(len(SCALES))
    for n, (image, mask) in enumerate(zip(images, inside, strict=True)):
        shares = _shares(mask)
        textures = {b: _textures(image[b] / unit[b], mask, shares) for b in {*partner_of, *partner_of.values()}}
        for b, partner in partner_of.items():
            for i, (own, other) in enumerate(zip(textures[b], textures[partner], strict=True)):
                counted = clear[n][b, i] if clear and i < len(shares) else mask
                total[i] += float(np.multiply(own[counted], other[counted], dtype=np.float64).sum())
                pixels[i] += int(counted.sum())
    return np.asarray(total / np.maximum(pixels, 1))


def _textures(plane: Float32, mask: Mask, shares: Sequence[Float32]) -> list[Float32]:
    """Texture (as in `powers`) at `SCALES` of a plane (row, column), valid in `mask`; `shares` is from `_shares`."""
    out, finer = [], (values := np.where(mask, plane, np.float32(0)))
    for side, share in zip(SCALES[1:], shares, strict=True):
        coarser = cv2.blur(values, (side, side)) / share  # means of the mask's pixels alone
        out.append(finer - coarser)
        finer = coarser
    return [*out, finer - (finer[mask].mean() if mask.any() else np.float32(0))]


def partners(setting: Setting, unit: Float32) -> dict[int, int]:
    """Partner of each evaluated band (0-based): the evaluated band of nearest wavelength that was taken at least 0.1 s
    (`LASTS`) earlier or later. Both bands show the same water, but different sparkle and noise. Bands without a partner
    are left out. The result is empty if the times of the bands are not known. `unit` is as in `powers`.
    """
    judged, times, waves = np.flatnonzero(np.isfinite(unit)), setting.offsets, setting.wavelengths
    if times is None:
        return {}
    others = {b: judged[np.abs(times[judged] - times[b]) >= LASTS] for b in judged.tolist()}
    away = np.nan_to_num(np.abs(waves[:, None] - waves), nan=np.inf)  # (band, band) [nm]
    return {b: int(some[away[b, some].argmin()]) for b, some in others.items() if some.size}


def least_signal(
    images: Sequence[Float32], inside: Sequence[Mask], unit: Float32, noises: Float32, nir: int, spectrum: Float32
) -> Float64:
    """Lower limit of the power of the scene's own texture, (scale,): the power that neither noise nor glint explains.

    The limit is the mean over the bands of the power divided by the square of the unit.

    images : (band, row, column) of each tile, not corrected
    inside, unit : as in `powers`
    noises : (band,) standard deviation of the noise [unit of the band]
    nir, spectrum : 0-based NIR band; (band,) glint in each band, divided by the glint in the NIR band
    """

    def of_band(band: int) -> Float64:
        return powers(images, inside, np.where(np.arange(len(unit)) == band, np.float32(1), np.float32(np.inf)))

    white = -np.diff([*(1 / s**2 for s in SCALES), 0.0])  # power of white noise of standard deviation 1 at each scale
    judged, reference = np.flatnonzero(np.isfinite(unit)).tolist(), of_band(nir)
    total = np.zeros(len(SCALES))
    for b in judged:
        found = of_band(b) - (GLINT_OF_NIR * spectrum[b]) ** 2 * reference - noises[b] ** 2 * white
        total += np.maximum(found, 0) / unit[b] ** 2
    return np.asarray(total / max(len(judged), 1))


def least_glint(glint: Sequence[Float32], inside: Sequence[Mask]) -> list[Mask]:
    """Mask of each tile, (band, scale, row, column), of the tenth of its pixels with the least glint around them.

    `glint` is the glint (band, row, column) of each tile; `inside` is as in `powers`. The coarsest scale has no mask.
    """
    out = []
    for planes, mask in zip(glint, inside, strict=True):
        clear = np.zeros((len(planes), len(SCALES) - 1, *mask.shape), np.bool_)
        for i, (side, share) in enumerate(zip(SCALES[1:], _shares(mask), strict=True)):
            for b, plane in enumerate(planes if mask.any() else ()):
                around = cv2.blur(np.where(mask, plane, np.float32(0)), (side, side)) / share
                clear[b, i] = mask & (around <= np.percentile(around[mask], LEAST_GLINT_PERCENT))
        out.append(clear)
    return out


def _shares(mask: Mask) -> list[Float32]:
    """Share of True pixels in the square around each pixel, (row, column), for each side in `SCALES[1:]`; above 0."""
    known = mask.astype(np.float32)
    return [np.maximum(cv2.blur(known, (side, side)), np.float32(1e-6)) for side in SCALES[1:]]


def level_excess(
    results: Sequence[Sequence[Float32]],
    inside: Sequence[Mask],
    unit: Float32,
    opened: Sequence[bool | None],
    delayed: bool,
) -> Float64:
    """How much brighter each result is than the darkest result of the other kind of recipe, (recipe,).

    The two kinds are recipes with and without an opening. In each band medians are compared or, if bands are taken at
    different times (`delayed`), means: a removal then leaves sparkle on few pixels, which a median ignores. Differences
    above 0 are divided by `unit`; their root mean square over the bands minus `SIGNAL`, at least 0, is returned.

    results : (band, row, column) of each tile, for each recipe
    inside, unit : as in `powers`
    opened : for each recipe, whether it contains an opening; None for a copy, whose excess is 0
    """
    judged, average = np.flatnonzero(np.isfinite(unit)), np.mean if delayed else np.median
    pixels = (np.concatenate([i[:, m] for i, m in zip(images, inside, strict=True)], axis=1) for images in results)
    levels = np.array([[average(values[b]) for b in judged] for values in pixels])
    excess = np.zeros(len(results))
    for kind in (True, False):
        own, other = (np.array([o is k for o in opened]) for k in (kind, not kind))
        if own.any() and other.any():
            least = np.maximum(levels[other], 0).min(axis=0)
            excess[own] = np.sqrt(np.mean((np.maximum(levels[own] - least, 0) / unit[judged]) ** 2, axis=1))
    return np.maximum(excess - SIGNAL, 0)


def erased(taken: Sequence[Float32], inside: Sequence[Mask], unit: Float32, nir: int, spectrum: Float32) -> float:
    """Mean brightness that an opening takes and that cannot be glint, root mean square over bands and tiles.

    Sparkle lies at different places in the bands, but its mean over a tile is that in the NIR times the glint spectrum.
    What an opening takes beyond `GLINT_OF_NIR` times this product is a signal, such as a bottom dark in the NIR.

    taken : (band, row, column) of each tile: image minus result
    inside, unit : as in `powers`; each band is divided by its unit
    nir, spectrum : as in `least_signal`
    """
    means = np.array([t[:, m].mean(axis=1) for t, m in zip(taken, inside, strict=True) if m.any()])  # (tile, band)
    more = [np.maximum(m - GLINT_OF_NIR * spectrum * m[nir], 0) / unit for m in means]
    return float(np.sqrt(np.square(more).sum() / max(len(means) * np.isfinite(unit).sum(), 1)))


def expected_errors(
    power: Float64,
    limits: tuple[Float64, Float64],
    gain: Float64,
    objects: Float64,
    least: Float64 | float = 0.0,
    edges: float = 0.0,
) -> Float64:
    """Expected root mean square error, (recipe,), relative to the water, without `level_excess` and `erased`.

    power : (recipe, scale): `powers` of the result
    limits : two arrays (recipe, scale), upper limits of the power of the scene's own signal that the recipe preserves:
        `powers` with `partners`, over all pixels, and over the pixels with the least glint
    gain : (recipe, scale): share of implanted textures (at the coarsest scale, of plumes) that the recipe preserves
    objects : (recipe,): share of implanted discs that the recipe preserves
    least : (scale,), lower limit of the power of the scene's own signal, from `least_signal`
    edges : share of the scene's own signal that is edges of large objects; their gain is at least that of the discs
    """
    own = gain.copy()
    own[:, :-1] += edges * np.maximum(np.minimum(objects, 1)[:, None] - gain[:, :-1], 0)
    kept = np.clip(own, [ZERO_GAIN] * (gain.shape[1] - 1) + [HALF], 1) ** 2
    bound, clear_bound = (np.maximum(p / kept, 0).min(axis=0) for p in limits)
    signal = np.maximum(np.sqrt(bound * np.minimum(bound, clear_bound)), least)
    error = np.maximum(power + (1 - 2 * own) * signal, 0)[:, :-1].sum(axis=1)
    coarse = np.sqrt(power[:, -1] / max(float(power[:, -1].max()), np.finfo(np.float64).tiny))
    error += np.square(1 - np.maximum(coarse, gain[:, -1])) * signal[-1]
    error += SHARE * (np.square(PLUME * (1 - gain[:, -1])) + np.square(BRIGHT * (1 - objects)))
    error += SIGNAL**2 * np.square(1 - gain[:, :-1]).sum(axis=1)
    return np.asarray(np.sqrt(error), np.float64)
