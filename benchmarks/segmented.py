"""Does RX by classes pay? `python -m benchmarks segmented [--directory DIRECTORY]`.

Classes of pixels by k-means, a mean and covariance of each, and every pixel against its own class, as in the segmented
RX of Matteoli, Diani and Corsini (2010), IEEE Aerospace and Electronic Systems Magazine 25 (7), 5-28,
doi:10.1109/MAES.2010.5546306; beside one background for all, and a ring around each pixel. On seas with known objects,
and on ships of real scenes where they lie in DIRECTORY (by default beside the project).
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from sklearn.cluster import MiniBatchKMeans
from sklearn.metrics import roc_auc_score

from deglint import open_scene
from deglint.physics.presets import preset
from detect import local_rx
from detect.bench import simulated
from detect.bench.section import over_seeds
from detect.rx import rx

from .error import DATA
from .ships import NIR, RATES, WINDOW, as_the_command_does, at_sea, figures
from .timing import say

CLASSES = (2, 4, 8)
WIND, DELAY, SEEDS = 9.0, 0.06, 3
SAMPLE = 50_000


def segmented_rx(image: np.ndarray, sea: np.ndarray, classes: int) -> np.ndarray:
    """Score of every pixel against the class that it belongs to; NaN outside."""
    pixels = image[:, sea].T.astype(np.float64)
    scaled = (pixels - pixels.mean(axis=0)) / pixels.std(axis=0)
    rng = np.random.default_rng(0)
    means = MiniBatchKMeans(classes, n_init=3, random_state=0)
    means.fit(scaled[rng.choice(len(scaled), min(SAMPLE, len(scaled)), replace=False)])
    labels = np.full(image.shape[1:], -1)
    labels[sea] = means.predict(scaled)
    out = np.full(image.shape[1:], np.nan, np.float32)
    for number in range(classes):
        own = labels == number
        if own.sum() > len(image):
            out[own] = rx(image, mask=own)[own]
    return out


def detectors(image: np.ndarray, sea: np.ndarray) -> dict[str, np.ndarray]:
    """Scores by each detector."""
    found = {"rx": rx(image, mask=sea), "local 15,31": local_rx(image, mask=sea, **WINDOW)}
    return found | {f"{k} classes": segmented_rx(image, sea, k) for k in CLASSES}


def on_truth(place: Path) -> None:
    """Areas under the curves of objects under water, before and after removal."""
    areas: dict[tuple[str, str], list[list[float]]] = {}
    for seed in range(SEEDS):
        (seen,) = simulated.see(simulated.setups([preset("thesis").delayed(DELAY)], WIND, seed), place, "sea")
        everywhere = np.ones(seen.raw.shape[1:], np.bool_)
        for what, image in (("raw", seen.raw), ("deglint remove", seen.cleaned("auto", "auto"))):
            for name, scores in detectors(image.astype(np.float32), everywhere).items():
                empty = scores[seen.kinds == 0]
                each = []
                for kind in range(1, len(simulated.REFLECTANCES) + 1):
                    there = scores[seen.kinds == kind]
                    truth = np.repeat([0, 1], [empty.size, there.size])
                    each.append(roc_auc_score(truth, np.concatenate([empty, there])))
                areas.setdefault((what, name), []).append(each)
    head = ("scene", "detector", *(f"AUC, objects of {100 * r:g} %" for r in simulated.REFLECTANCES))
    rows = [
        [*key, *(str(over_seeds(a, better="higher")) for a in zip(*found, strict=True))] for key, found in areas.items()
    ]
    say(f"Simulated, {WIND:g} m/s, {1000 * DELAY:g} ms, {SEEDS} seeds", head, rows)


def on_ships(directory: Path) -> None:
    """Ships found at each rate, and false objects."""
    for name in ("casablanca", "honolulu"):
        scene = open_scene(directory / f"{name}.tif", nir="B08")
        ships = open_scene(directory / f"{name}_ships.tif").read()[0].astype(int)
        sea, rows = at_sea(scene, 0), []
        for what, image in (("raw", scene.read()), ("deglint remove", as_the_command_does(scene))):
            clean = image[: NIR + 1].astype(np.float32)
            sound = sea & np.isfinite(clean).all(axis=0)
            rows += [[what, n, *figures(s, ships, sea)] for n, s in detectors(clean, sound).items()]
        say(name, ("scene", "detector", *(f"ships and false objects at Pfa {r:g}" for r in RATES)), rows)


def main(directory: Path | None) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as place:
        on_truth(Path(place))
    directory = directory or DATA / "sentinel2"
    if (directory / "casablanca_ships.tif").exists():
        on_ships(directory)
    else:
        print("\nships: --directory names where casablanca.tif, honolulu.tif and their *_ships.tif lie.")
