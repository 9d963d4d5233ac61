"""What to do with a scene, and where results go: the options of `rxdetect score`, as frozen values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from deglint.checks import checked_keywords
from deglint.errors import InputError

from ..background import RIDGE, check_rule
from ..local import BORDERS
from ..rx import GLOBAL_METHODS
from ..sea import SIDES
from ..sea.region import LARGEST

METHODS = {
    "sea": "distance from the water around, floating objects of the sea included",
    "local": "squared Mahalanobis distance from the ring around the pixel (--window)",
    "lines": "squared Mahalanobis distance from the lines before, one line after the other",
    **GLOBAL_METHODS,
}
"""Detectors, with what they are; "auto" is sea where there is water and pixels are compared with it, else rx."""
THRESHOLDS = {
    "gpd": "tail fitted to the scores",
    "empirical": "quantile of the scores",
    "f": "F",
    "chi2": "chi-squared",
}
"""How the threshold for --pfa is found."""
NO_LAW = ("utd", "rx-utd", "sea", "lines")
"""Detectors whose scores follow no known law even over a normal background."""
WINDOW = (5, 21)
"""Guard and window of local RX, unless they are said [pixel]."""


@dataclass(frozen=True)
class Recipe:
    """What to do; every field has a default.

    Attributes
    ----------
    method : str
        "auto", or a key of `METHODS`.
    window : (int, int)
        Guard and window of "local" [pixel].
    border, ddof : str, int
        As `detect.local.local_rx`.
    covariance, ridge : str, float
        As `detect.background.fit`; "local" knows "empirical" and "ridge".
    background : str
        "" for everything valid; else a GeoJSON file, mask raster, window, or a saved background.
    bands, nir : tuple of str
        Bands to use, all where empty, and the NIR (for "residual" and the water mask), by name or 1-based number.
    drop : int
        Leading eigenvectors that "subspace" leaves out.
    mask : str
        Where to score: "none" (everywhere), "water" (found in the scene), or a raster, GeoJSON file or window; "auto"
        is water for "sea", else everywhere. "sea" closes the mask over what floats.
    pfa : float, optional
        False alarms wanted per pixel.
    threshold : str
        A key of `THRESHOLDS`.
    false_per_km2 : float, optional
        False objects wanted per km2 of sea, in place of pfa; for "sea".
    largest_object : (float, float)
        Length and width of the largest object that floats [m]; for "sea".
    side : str
        "auto", "bright" or "both": which anomalies count; for "sea".
    moving : bool
        Give objects a speed and a heading, from bands that look at different times.
    min_size, merge_distance
        As `detect.objects.find`.
    """

    method: str = "auto"
    window: tuple[int, int] = WINDOW
    border: str = "shrink"
    ddof: int = 1
    covariance: str = "empirical"
    ridge: float = RIDGE
    background: str = ""
    bands: tuple[str, ...] = ()
    nir: tuple[str, ...] = ()
    drop: int = 1
    mask: str = "auto"
    pfa: float | None = None
    threshold: str = "gpd"
    false_per_km2: float | None = None
    largest_object: tuple[float, float] = LARGEST
    side: str = "auto"
    moving: bool = False
    min_size: int = 1
    merge_distance: float = 0.0

    def __post_init__(self) -> None:
        for name, known in (
            ("method", ("auto", *METHODS)), ("threshold", THRESHOLDS), ("side", ("auto", *SIDES)), ("border", BORDERS),
        ):  # fmt: skip
            if getattr(self, name) not in known:
                raise InputError(f"{name} {getattr(self, name)!r} is not one of {', '.join(known)}.")
        check_rule(self.covariance, self.ridge)
        if self.pfa is not None and not 0 < self.pfa < 1:
            raise InputError(f"pfa: allowed is above 0 and below 1, got {self.pfa}.")
        self._check_local()
        self._check_sea()
        if self.method == "lines" and (self.background or self.covariance != "empirical"):
            raise InputError("lines are compared with the lines before: leave out --background and --covariance.")
        if self.pfa is not None and self.threshold in ("chi2", "f") and self.method in NO_LAW:
            raise InputError(
                f"{self.method} scores follow neither chi-squared nor F: take --threshold empirical or gpd."
            )

    @property
    def thresholded(self) -> bool:
        """Whether a threshold is wanted."""
        return self.pfa is not None or self.false_per_km2 is not None

    def _check_sea(self) -> None:
        if self.false_per_km2 is not None:
            if not self.false_per_km2 > 0:
                raise InputError(f"false-per-km2: allowed is above 0, got {self.false_per_km2}.")
            if self.pfa is not None:
                raise InputError("pfa and false-per-km2 both state the false-alarm rate: give one of them.")
            if self.method not in ("auto", "sea"):
                raise InputError(f"false-per-km2 needs --method sea, got {self.method}. Give --pfa.")
        if self.method == "sea" and self.threshold in ("chi2", "f"):
            raise InputError("sea scores follow neither chi-squared nor F: take --threshold gpd or empirical.")

    def _check_local(self) -> None:
        if self.method != "local":
            return
        if self.covariance not in ("empirical", "ridge"):
            raise InputError(
                f"local takes covariance empirical or ridge, got {self.covariance}: the ring of a pixel is too small "
                "to estimate more."
            )
        if self.background:
            raise InputError("local takes the ring around each pixel as its background: leave out --background.")


Recipe.__init__ = checked_keywords()(Recipe.__init__)  # type: ignore[method-assign]


@dataclass(frozen=True)
class Outputs:
    """Where results go.

    Attributes
    ----------
    image : Path
        The scores; the sidecar is `image` with ".json" appended.
    p_value, flags, objects, background : Path, optional
        Raster of p-values, raster of `detect.pipeline.flags.MEANINGS`, detected objects as GeoJSON, the fitted
        background.
    overwrite : bool
        Replace what exists.
    options : mapping
        GDAL creation options.
    chips : Path, optional
        Folder of a picture of every object.
    """

    image: Path
    p_value: Path | None = None
    flags: Path | None = None
    objects: Path | None = None
    background: Path | None = None
    overwrite: bool = False
    options: Mapping[str, str] = field(default_factory=dict)
    chips: Path | None = None

    @property
    def sidecar(self) -> Path:
        """Name of the sidecar."""
        return self.image.parent / f"{self.image.name}.json"

    def every(self) -> list[Path]:
        """All files that will be written."""
        extra = (self.p_value, self.flags, self.objects, self.background)
        return [self.image, self.sidecar, *(p for p in extra if p is not None)]
