"""Search for objects on the sea in an array: classify, fit, score, and list the objects as plain records."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import Float32
from ..background import as_image, as_mask
from ..objects import find, find_among
from ..threshold import Tail, Threshold
from .model import SeaModel, fit, score
from .rates import LOW, Clutter, clutter_of
from .region import ALONGSIDE, ATTACHED, Classes, SeaRule, region


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a search of the sea.

    Attributes
    ----------
    scores : (row, column) ndarray of float32
        Distance from the water around [standard deviation]; NaN where there is no sea.
    classes : (row, column) ndarray of uint8
        From `detect.sea.region`.
    objects : list of dict
        One record per object, highest score first; `pandas.DataFrame(search.objects)` makes a table.
    threshold : Threshold
    clutter : Clutter
        Converts a score to the expected number of false objects per km2.
    model : SeaModel
    """

    scores: Float32
    classes: Classes
    objects: list[dict[str, Any]]
    threshold: Threshold
    clutter: Clutter
    model: SeaModel


def score_scene(
    image: npt.ArrayLike, water: npt.ArrayLike | None = None, *, pixel: float = 10.0, pfa: float = 1e-4,
    side: str | None = None,
) -> Search:  # fmt: skip
    """Search the sea of an image for ships, boats and swimmers.

    Parameters
    ----------
    image : (band, row, column) array
        NaN where not valid. The visible bands of a deglinted scene give the best results.
    water : (row, column) array of bool, optional
        Water mask with holes at floating objects; all valid pixels by default.
    pixel : float
        Side of a pixel [m].
    pfa : float
        Requested false-alarm rate per pixel.
    side : str, optional
        "bright" or "both"; by default determined from the size of a pixel.

    Returns
    -------
    Search

    Raises
    ------
    InputError
        The shapes of image and mask differ.
    NoWaterError
        The image has fewer than 100 pixels of water.

    Examples
    --------
    >>> sea = np.random.default_rng(0).normal(100, 3, (3, 200, 200))
    >>> sea[:, 50:53, 60:70] += 60
    >>> [(round(o["row"]), round(o["column"])) for o in score_scene(sea).objects[:1]]
    [(51, 65)]
    """
    values = as_image(np.asarray(image))
    valid = np.asarray(np.isfinite(values).all(axis=0))
    inside = None if water is None else as_mask(np.asarray(water), values)
    mask = valid if inside is None else inside & valid
    classes = region(mask, SeaRule(pixel), valid)
    model = fit([(values, classes)], pixel=pixel, side=side)
    scores = score(values, classes, model)
    searched = np.where(classes == ALONGSIDE, np.float32(np.nan), scores)
    tail = Tail.of(searched, Tail.keep_for(max(pfa, 0.04), searched.size))
    candidates = find(searched > LOW * model.q90, scores)
    clutter = clutter_of(tail, candidates, model.q90, area=tail.n * (pixel * pixel) / 1e6, fine=model.side == "both")
    threshold = clutter.threshold(pfa)
    searched[classes == ATTACHED] = np.nan
    rows, columns = np.nonzero(searched > min(LOW * model.q90, threshold.value))
    found = find_among(rows, columns, searched[rows, columns], above=threshold.value, pixel_area=pixel * pixel)
    records = [
        {"label": o.label, "score": o.score_max, "pixels": o.size, "area_m2": o.area, "row": o.centroid[0],
         "column": o.centroid[1], "false_per_km2": clutter.false_per_km2(o.score_top)} for o in found
    ]  # fmt: skip
    return Search(scores, classes, records, threshold, clutter, model)
