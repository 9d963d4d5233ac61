"""How much do pixels of 25 cm sparkle? Facets of 6 cm with patches (`Setup.patch`), against waves resolved to 1 mm.

    python -m benchmarks sparkle [--wind 9] [--rounds 10]

Prints, for glint far from the specular point and near it, the coefficient of variation of the pixels, and the
correlation of the pixels with the same pixels after 10, 60 and 120 ms. `Setup.patch` should be the patch size whose
numbers are nearest to those of the resolved waves. The side of the sea is only 2 m, so that 1 mm can be afforded. The
longer waves that are left out would tilt facets and resolved waves in the same way.
"""

import numpy as np

import deglint.physics.surface as surface
from deglint.physics.slopes import gaussian
from deglint.physics.waves import Sea
from deglint.simulate.facets import sparkle_frequencies, sparkle_share

SEA_SIDE, POINTS, FACETS, SEA_PIXELS = 2.0, 2048, 32, 8  # side of the sea [m], and its points, facets and pixels
LAGS = (0.0, 0.010, 0.060, 0.120)
SPOT = 0.03  # standard deviation of the slopes about a fine point
PATCHES = (0.0, 0.005, 0.01, 0.015, 0.03, 0.06)


def glint(up, cross, wanted, variance):
    """Glint of each pixel: mean density, over its points, at the slope `wanted`, which mirrors the sun."""
    n = len(up) // SEA_PIXELS
    density = gaussian(up - wanted[0], cross - wanted[1], *variance)
    return density.reshape(SEA_PIXELS, n, SEA_PIXELS, n).mean(axis=(1, 3))


def resolved(sea, seed, far):
    """Glint of a sea that is resolved to 1 mm, at each lag, and the variance of its slopes."""
    drawn = surface.realise(sea, shape=(POINTS, POINTS), spacing=SEA_SIDE / POINTS, seed=seed, workers=2)
    variance = np.array(drawn.slope_variance) + SPOT**2
    wanted = (0.0, far * np.sqrt(variance[1]))
    packed = (drawn.packed_slopes(t, workers=2) for t in LAGS)
    return [glint(p.imag, p.real, wanted, (SPOT**2, SPOT**2)) for p in packed], variance


def faceted(sea, seed, far, variance, patch, frequencies):
    """Glint of a sea of 6 cm facets, at each lag. Sparkle and spread within facets have the rest of the variance."""
    drawn = surface.realise(sea, shape=(FACETS, FACETS), spacing=SEA_SIDE / FACETS, seed=seed)
    unresolved = variance - drawn.slope_variance
    share = sparkle_share(patch, SEA_SIDE / FACETS)
    generator = np.random.default_rng(seed)
    tilt = generator.standard_normal((4, FACETS, FACETS)) * np.sqrt(np.repeat(share * unresolved, 2))[:, None, None]
    frequency = generator.choice(frequencies, (FACETS, FACETS))
    wanted, out = (0.0, far * np.sqrt(variance[1])), []
    for t in LAGS:
        packed, c, s = drawn.packed_slopes(t), np.cos(frequency * t), np.sin(frequency * t)
        up, cross = packed.imag + tilt[0] * c + tilt[1] * s, packed.real + tilt[2] * c + tilt[3] * s
        out.append(glint(up, cross, wanted, (1 - share) * unresolved))
    return out


def report(name, values):
    start, *later = (np.ravel([v[i] for v in values]) for i in range(len(LAGS)))
    alike = " ".join(f"{np.corrcoef(start, x)[0, 1]:6.2f}" for x in later)
    print(f"{name:<22}{start.std() / start.mean():6.2f}   {alike}")


def main(wind, rounds):
    count = rounds or 10
    surface._check_grid = lambda *_: None  # the peak wave is left out on purpose
    sea = Sea(wind=wind)
    frequencies = sparkle_frequencies(sea, SEA_SIDE / FACETS)
    for far in (2.2, 1.0):
        print(f"\nglint at {far:g} sigma      CV     10 ms  60 ms 120 ms")
        fine = [resolved(sea, seed, far) for seed in range(count)]
        report("resolved to 1 mm", [f for f, _ in fine])
        for patch in PATCHES:
            seeds = range(1000, 1000 + 6 * count)
            made = [faceted(sea, s, far, fine[0][1], patch, frequencies) for s in seeds]
            report(f"patch {1000 * patch:g} mm", made)
