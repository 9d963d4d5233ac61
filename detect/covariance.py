"""Estimators of the covariance of a background (shrunk, robust), and whitening matrix of any covariance.

The estimators do not depend on the units of the bands, because they standardise the bands. Bands that do not vary are
ignored. Of linearly dependent bands, only the independent directions are used, so a covariance may be singular.

References
----------
Ledoit, Wolf (2004), "A well-conditioned estimator for large-dimensional covariance matrices", Journal of Multivariate
Analysis 88, 365-411, doi:10.1016/S0047-259X(03)00096-4.
Chen, Wiesel, Eldar, Hero (2010), "Shrinkage algorithms for MMSE covariance estimation", IEEE Transactions on Signal
Processing 58, 5016-5029, doi:10.1109/TSP.2010.2053029.
Rousseeuw, Van Driessen (1999), "A fast algorithm for the minimum covariance determinant estimator", Technometrics 41,
212-223, doi:10.1080/00401706.1999.10485670.
Hubert, Rousseeuw, Verdonck (2012), "A deterministic algorithm for robust location and scatter", Journal of
Computational and Graphical Statistics 21, 618-637, doi:10.1080/10618600.2012.672100.
"""

import numpy as np

from .arrays import Array, Float64

TOLERANCE = 10 * np.finfo(np.float64).eps
"""Relative rounding error. Eigenvalues up to this times the number of bands times the largest eigenvalue count as 0."""
_STEPS = 100  # maximum number of concentration steps; a dozen are usual
_TRIM = 0.975  # fraction of a normal background that the last, reweighted step of the robust estimate keeps


def standardised(covariance: Float64) -> tuple[Float64, Float64]:
    """Correlation matrix, (bands, bands), and 1 / standard deviation, (bands,); both are 0 for a constant band."""
    with np.errstate(divide="ignore"):
        scale = np.where(np.diag(covariance) > 0, 1 / np.sqrt(np.diag(covariance)), 0.0)
    return covariance * scale[:, None] * scale, scale


def whitener(covariance: Float64) -> Float64:
    """Whitening matrix W, (rank, bands): for a pixel x, the components of W x are uncorrelated, with unit variance.

    W^T W is the inverse of the covariance. If the covariance is singular, W^T W is a pseudo-inverse, computed from the
    correlation, so that it does not depend on the units. Columns of bands that do not vary are 0.
    """
    correlation, scale = standardised(covariance)
    values, vectors = np.linalg.eigh(correlation)
    kept = values > TOLERANCE * len(values) * max(values[-1], 0.0)
    return np.asarray(vectors[:, kept].T / np.sqrt(values[kept])[:, None] * scale)


def ridged(covariance: Float64, ridge: float) -> Float64:
    """Add `ridge` times the variance of each band to the diagonal of a covariance, (bands, bands)."""
    return covariance + ridge * np.diag(np.diag(covariance))


def shrunk(covariance: Float64, shrinkage: float) -> Float64:
    """Covariance whose correlation is shrunk towards the identity with the weight `shrinkage`, 0 to 1."""
    return (1 - shrinkage) * covariance + shrinkage * np.diag(np.diag(covariance))


def oas_shrinkage(covariance: Float64, n: int) -> float:
    """Oracle-approximating weight for `shrunk`, from n pixels (Chen et al. 2010, eq. 23, terms 2 / bands omitted)."""
    correlation, scale = standardised(covariance)
    p = int(np.count_nonzero(scale))
    if p < 2:
        return 0.0
    alpha = float((correlation**2).sum()) / p**2
    denominator = (n + 1) * (alpha - 1 / p)
    return 1.0 if denominator <= 0 else float(min((alpha + 1) / denominator, 1.0))


def ledoit_wolf_shrinkage(covariance: Float64, n: int, sample: Float64) -> float:
    """Weight for `shrunk` as in Ledoit and Wolf (2004, lemmas 3.2-3.4), for the covariance of n pixels.

    The covariance has the divisor n, not n - 1. `sample`, (pixels, bands), holds some or all pixels minus the mean.
    """
    correlation, scale = standardised(covariance)
    p = int(np.count_nonzero(scale))
    total = float((correlation**2).sum())
    distance = total - p  # |R - I|^2, because the diagonal of R is 1
    if p < 2 or distance <= 0 or not len(sample):
        return 0.0
    fourth = float((((sample * scale) ** 2).sum(axis=1) ** 2).mean())
    return float(min(max(fourth - total, 0.0) / n, distance) / distance)


def robust(sample: Array, keep: float = 0.75) -> tuple[Float64, Float64, int]:
    """Robust mean and covariance by the minimum covariance determinant, and the number of pixels that contribute.

    `sample`, (pixels, bands), must be finite. The core is a fraction `keep` (0.5 to 1) of the pixels, selected so that
    the determinant of their covariance is smallest. It is found by concentration steps (Rousseeuw, Van Driessen 1999,
    theorem 1) from three deterministic estimates (Hubert et al. 2012). Mean and covariance are then computed from all
    pixels near the core, and the covariance is scaled so that it is consistent for a normal background.
    """
    from scipy.stats import chi2

    centre = np.median(sample, axis=0)
    x = sample - centre
    spread = np.median(np.abs(x), axis=0) * 1.4826
    spread = np.where(spread > 0, spread, x.std(axis=0))  # more than half of the pixels may be equal
    scaled = np.divide(x, spread, out=np.zeros_like(x, np.float64), where=spread > 0)
    count = max(int(np.ceil(keep * len(x))), min(len(x), x.shape[1] + 2))
    found = [_concentrate(scaled, count, *start) for start in _starts(scaled, count)]
    mean, covariance, _volume = min(found, key=lambda core: core[2])
    bands = max(int(np.count_nonzero(spread > 0)), 1)
    covariance = covariance * (np.median(_distances(scaled, mean, covariance)) / chi2.ppf(0.5, bands) or 1.0)
    inside = _distances(scaled, mean, covariance) <= chi2.ppf(_TRIM, bands)
    if np.count_nonzero(inside) <= bands:
        inside[:] = True
    core = scaled[inside]
    factor = _TRIM / chi2.cdf(chi2.ppf(_TRIM, bands), bands + 2)
    covariance = factor * np.cov(core, rowvar=False).reshape(len(spread), -1) * np.outer(spread, spread)
    return centre + core.mean(axis=0) * spread, covariance, len(core)


def _starts(x: Float64, count: int) -> list[tuple[Float64, Float64]]:
    """Three initial estimates (mean, covariance) for `_concentrate`; `x` and `count` are its parameters."""
    bands = x.shape[1]
    length = np.sqrt((x**2).sum(axis=1))
    near = x[np.argpartition(length, count - 1)[:count]]
    signs = x / np.where(length > 0, length, 1)[:, None]
    squashed = np.tanh(x)
    return [
        (near.mean(axis=0), np.cov(near, rowvar=False).reshape(bands, bands)),
        (np.zeros(bands), bands * signs.T @ signs / len(x)),
        (squashed.mean(axis=0), np.cov(squashed, rowvar=False).reshape(bands, bands)),
    ]


def _concentrate(x: Float64, count: int, mean: Float64, covariance: Float64) -> tuple[Float64, Float64, float]:
    """Refit a mean and covariance to the `count` pixels nearest to the mean, until the determinant stops decreasing.

    Bands of `x`, (pixels, bands), have median 0 and robust deviation 1. Returns mean, covariance and log determinant.
    """
    before = np.inf
    for _ in range(_STEPS):
        core = x[np.argpartition(_distances(x, mean, covariance), count - 1)[:count]]
        mean = core.mean(axis=0)
        covariance = np.cov(core, rowvar=False).reshape(x.shape[1], -1)
        values = np.linalg.eigvalsh(covariance)
        values = values[values > TOLERANCE * len(values) * max(values[-1], 0.0)]
        volume = float(np.log(values).sum())
        if not volume < before:
            break
        before = volume
    return mean, covariance, volume


def _distances(x: Float64, mean: Float64, covariance: Float64) -> Float64:
    """Squared Mahalanobis distances of the pixels x, (pixels, bands), from a mean; (pixels,)."""
    return np.asarray((((x - mean) @ whitener(covariance).T) ** 2).sum(axis=1))
