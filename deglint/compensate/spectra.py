"""Models (normal distributions) of spectra of targets on the sea, and of flashes of glint that last in all bands.

A target is either painted (its spectrum has steep edges), or grey and under 0 to 5 m of water. Measured spectra of
targets are not needed: an image with eight bands does not resolve the details of such spectra.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..moments import Float64
from ..physics.iops import case1
from .state import Float32

Places = npt.NDArray[np.intp]
Model = tuple[Float32, Float32, Float32]
"""For one brightness: quadratic forms (spectrum, pair of bands), constants of the log density (spectrum, 1), and
matrices (spectrum, band, band) that give the contrast of a target from the excess; of a flash, there is one spectrum
and no matrix."""

TARGET_DEPTHS = 0.0, 1.5, 5.0
"""Depths of grey targets [m]: at the surface, a swimmer, and where the red is nearly absorbed."""
RISES, FALLS = (470, 500, 530, 560, 590, 605, 620, 650, 690, 720, 750), (470, 490, 510, 530, 560, 590, 620)
DYES = tuple((fall, rise) for fall in (490, 510, 540, 580) for rise in (690, 730))
GREENS = (450, 510), (480, 530), (500, 560), (510, 590)
"""Wavelengths of the edges of paint [nm], as far apart as eight bands resolve. `RISES`: dark below the edge (yellow to
red). `FALLS`: dark above it (blue to cyan). `DYES`: dark between two edges (dyes that are transparent in the NIR).
`GREENS`: bright between two edges."""
EDGE, EDGE_SHIFT, DIM = 15.0, 8.0, 0.07
"""Width of an edge [nm], standard deviation of its wavelength [nm], reflectance of the dark over the bright side."""
SLOPE, BEND, ROUGH = 0.25, 0.15, 0.03
"""Standard deviations relative to the brightness: linear and quadratic part of a grey spectrum over 250 nm (for paint,
half of these), and the part that is not smooth. Its variance is `ROUGH` squared times the brightness of the band, not
times its square: then fewer red and blue targets would be found, as paint deviates more where it is dim."""
CHANGE, NO_CHANGE = 1.0, 0.15
"""Standard deviation of the linear and of the quadratic change from the first to the last band, relative to the
brightness. `CHANGE`: of a flash that lasts, for any rise or fall. `NO_CHANGE`: of a white target with sparkle on it."""
TEXTURE_DEVIATION, HIDDEN_CONTRAST = 0.05, 0.5
"""Standard deviations of the background and of the water that a target hides, relative to the radiance of water."""

UNEXPLAINED, LIKELIER, CHANGING = 5.0, 0.7, 0.2
"""`UNEXPLAINED`: log likelihood ratio (odds of 150 to 1) from which a pixel is no changing sparkle. For such pixels the
mean log likelihood ratio of flash and target, clipped to +- `UNEXPLAINED`, exceeds `LIKELIER` where flashes last. The
mean is -0.4 to 0.3 for boats, swimmers and whitecaps. With white targets included, it must exceed `CHANGING`."""
BLUR, VARIED = 0.012, 0.15
"""Share of the power of 3 x 3 pixels that is not the product of one outline and one spectrum. `BLUR`: point target,
whose blur differs between bands (0.7 to 2 % at f/10, less for extended targets). `VARIED`: sparkle."""


def reflectances(wavelengths: Float64, widths: Float64) -> tuple[Float64, Float64, Float64]:
    """Model spectra of targets in bands with centres `wavelengths` and full `widths`, (band,) both [nm].

    Returns values (spectrum, band), the reflectance divided by that of the brightest band; factors (spectrum, 5, band),
    the change of the values by one standard deviation of brightness, slope, curvature and the wavelengths of two edges;
    and the prior probability (spectrum,) of each spectrum: half of the targets are grey, half are painted.
    """
    inside = wavelengths[:, None] + widths[:, None] * np.linspace(-0.5, 0.5, 17)

    def between(low: float, high: float) -> Float64:
        rise, fall = (np.exp(np.clip(x / EDGE, -50, 50)) for x in (low - inside, inside - high))
        return np.asarray((1 / (1 + rise) / (1 + fall)).mean(axis=1))

    dark = [(-np.inf, a) for a in RISES] + [(a, np.inf) for a in FALLS] + list(DYES)
    paint = [1 - between(*p) for p in dark] + [between(*p) for p in GREENS]
    moved = [
        [between(a + EDGE_SHIFT, b) - between(a, b), between(a, b + EDGE_SHIFT) - between(a, b)]
        for a, b in (*dark, *GREENS)
    ]
    grey = np.exp(-2 * np.outer(TARGET_DEPTHS, case1(wavelengths, 0.1).absorption))
    values = np.concatenate([grey, DIM + (1 - DIM) * np.array(paint)])
    u = (wavelengths - 650) / 250
    factors = np.zeros((len(values), 5, len(u)))
    factors[:, :3] = values[:, None] * np.stack([np.ones_like(u), SLOPE * u, BEND * (u * u - (u * u).mean())])
    factors[len(grey) :, 1:3] /= 2
    factors[len(grey) :, 3:] = (1 - DIM) * np.array(moved)
    top = values.max(axis=1, keepdims=True)
    return values / top, factors / top[:, None], np.repeat([0.5 / len(grey), 0.5 / len(paint)], [len(grey), len(paint)])


@lru_cache(maxsize=8)
def flashes(glint: Sequence[float], time: Sequence[float], s: Sequence[float], change: float) -> list[Model]:
    """Models of a flash that lasts through all bands, one for each brightness 2**n with n = 0 to 16 [`Targets.light`].

    The brightness changes with time by a linear and a quadratic part. All arguments but `change` have a value per band.

    glint : spectrum of glint divided by that of a white target (`Targets.light`)
    time, s : time offset [s], and standard deviation of noise divided by `Targets.light`
    change : standard deviation of each part, relative to the brightness: `CHANGE`, or `NO_CHANGE` for a white target
    """
    u, spectrum = (np.array(time) - np.mean(time)) / np.ptp(time), np.array(glint) / max(glint)
    factors = spectrum * np.stack([np.ones_like(u), change * u, change * (u * u - (u * u).mean())])
    out, (row, column) = [], np.triu_indices(len(s))
    for A in 2.0 ** np.arange(17):
        C = A * A * factors.T @ factors + np.diag(np.square(s) + (ROUGH * A * spectrum) ** 2)
        form = A * A * np.linalg.inv(C)[row, column] * np.where(row == column, 0.5, 1)
        constant = np.full((1, 1), -0.5 * np.linalg.slogdet(2 * np.pi * C)[1], np.float32)
        out.append((form.astype("f4")[None], constant, np.zeros((0, len(s), len(s)), np.float32)))
    return out


@lru_cache(maxsize=8)
def models(
    wavelengths: Sequence[float], widths: Sequence[float], water: Sequence[float], s: Sequence[float]
) -> list[Model]:
    """Models of the spectra of targets, one for each brightness 2**n, n = 0 to 16, in units of `Targets.light`.
    All arguments are (band,): centre and full width [nm], radiance of water and standard deviation of noise [`light`].
    """
    values, factors, weight = reflectances(np.array(wavelengths), np.array(widths))
    unit, out, (row, column) = factors.swapaxes(1, 2) @ factors, [], np.triu_indices(len(s))
    for A in 2.0 ** np.arange(17):  # 16-bit data hold no more
        K = A * A * unit + HIDDEN_CONTRAST**2 * np.outer(water, water)
        V = np.square(s) + (ROUGH * A) ** 2 * values + (TEXTURE_DEVIATION * np.array(water)) ** 2
        C = K + V[:, :, None] * np.eye(len(s))
        constant = np.log(weight) - 0.5 * np.linalg.slogdet(2 * np.pi * C)[1]
        inverse = np.linalg.inv(C)
        form = A * A * inverse[:, row, column] * np.where(row == column, 0.5, 1)
        out.append((form.astype("f4"), constant.astype("f4")[:, None], (K @ inverse).astype("f4")))
    return out


def brightness(e: Float32) -> Places:
    """Exponent, 0 to 16, of the power of 2 nearest to the largest absolute excess e (band, pixel) of each pixel."""
    return np.clip(np.rint(np.log2(np.maximum(np.abs(e).max(axis=0), 1))), 0, 16).astype(np.intp)


def likelihoods(e: Float32, of: list[Model]) -> tuple[Float32, Places]:
    """Log likelihood of the likeliest spectrum, prior included, and the spectrum's index, (pixel,) each.

    e : (band, pixel), excess over the background divided by `Targets.light`
    of : the models of a target that `models` returns, or those of a flash that `flashes` returns
    """
    likelihood, kind = np.empty(e.shape[1], np.float32), np.empty(e.shape[1], np.intp)
    level, (row, column) = brightness(e), np.triu_indices(len(e))
    for n in np.unique(level):
        i = np.flatnonzero(level == n)
        x = e[:, i] * np.float32(0.5**n)
        form, constant, _ = of[n]
        p = constant - form @ (x[row] * x[column])  # e_i e_j / 4**n for bands i <= j, (pair, pixel)
        likelihood[i], kind[i] = p.max(axis=0), p.argmax(axis=0)
    return likelihood, kind


def lasting_flashes(
    e: Float32, sparkle: Float32, of_targets: list[Model], of_flashes: list[Model], of_white: list[Model]
) -> npt.NDArray[np.bool_]:
    """Mask (pixel,) of flashes that last through all bands; all False if such flashes are rare. `e` is as in
    `likelihoods`, for pixels bright in all bands; `sparkle` (pixel,) is the log likelihood of glint that changes.
    `of_targets` is the result of `models`; `of_flashes` and `of_white` that of `flashes` with `CHANGE` and `NO_CHANGE`.
    """
    target, flash, white = (likelihoods(e, of)[0] for of in (of_targets, of_flashes, of_white))
    unexplained = np.maximum(target, flash) - sparkle > UNEXPLAINED
    ratios = np.clip(flash - np.stack([target, np.maximum(target, white)]), -UNEXPLAINED, UNEXPLAINED)
    frequent = unexplained.any() and (ratios[:, unexplained].mean(axis=1) > (LIKELIER, CHANGING)).all()
    return np.asarray(unexplained & (ratios[0] > 0) & frequent)


def contrast(e: Float32, kind: npt.NDArray[np.uint8], of_targets: list[Model]) -> Float32:
    """Contrast of targets (band, pixel), at least 0 [unit of `e`]; `kind` is the index from `likelihoods`."""
    out, level = np.empty_like(e), brightness(e)
    for n in np.unique(level):
        i = np.flatnonzero(level == n)
        out[:, i] = (of_targets[n][2][kind[i]] @ e[:, i].T[:, :, None])[:, :, 0].T
    return np.maximum(out, 0)


def same_outline(patch: Float32) -> Float32:
    """Log likelihood ratio of target and sparkle, (pixel,), from the excess in 3 x 3 pixels, `patch` (pixel, 9, band).

    A target has the same outline in all B bands: the patch (excess divided by `Targets.light`) is the product of one
    outline and one spectrum. The share of the sum of squares that this product does not explain is modelled as the mean
    square of B - 1 normal variables. For a target their variance is that of noise and blur, for sparkle at least
    `VARIED`. The band with the largest residual is excluded at each pixel, as sparkle beside targets affects one band.
    """
    patch = patch.astype(np.float64)
    power = (patch**2).sum(axis=(1, 2))
    v = np.linalg.eigh(patch.swapaxes(1, 2) @ patch)[1][:, :, -1:]
    rest = (patch - patch @ v @ v.swapaxes(1, 2)) ** 2
    random = patch.shape[1] * patch.shape[2] / 2 / power  # half of it is in the worst bands
    share = np.maximum((rest.sum(axis=2) - rest.max(axis=2)).sum(axis=1) / power - random, 0)
    known = BLUR * (patch**2).sum(axis=2).max(axis=1) / power + random
    varied = np.maximum(VARIED, known)
    ratio = np.log(varied / known) - share * (1 / known - 1 / varied)
    return np.asarray((patch.shape[2] - 1) / 2 * ratio, np.float32)
