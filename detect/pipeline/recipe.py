"""Options of `rxdetect score`, as frozen dataclasses: `Recipe` for the processing, `Outputs` for the output files."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from deglint.checks import check_choice, check_number, checked_keywords
from deglint.errors import InputError

from ..background import RIDGE, check_rule
from ..global_rx import DETECTORS, Method
from ..local import BORDERS
from ..objects import FARTHEST
from ..sea.model import SIDES
from ..sea.region import LARGEST
from ..threshold import THRESHOLDS

SUFFIXES = (".geojson", ".json", ".gpkg")  # extensions of the file of objects
PICTURE = "object_{:04d}.png"  # name of the picture of an object, with the number of the object


@dataclass(frozen=True)
class Recipe:
    """Options of the processing in `score_file`; every field has a default.

    Attributes
    ----------
    method : str
        A key of `global_rx.DETECTORS`, or "auto". If an option that "sea" lacks is set, "auto" selects the method with
        this option. It selects "rx" if `threshold` is "f" or "chi2", if p-values or a background file are requested, if
        there are over 16 bands or under 100 pixels, or if the mask "auto" or "water" finds no water; otherwise "sea".
    window : (int, int)
        For "local": sides of the guard, and of the window around it [pixel].
    border, ddof : str, int
        For "local": as in `detect.local.local_rx`.
    covariance, ridge : str, float
        As in `detect.background.fit`; "sea" and "lines" allow only "empirical", "local" also allows "ridge".
    background : str
        Area of the background: "" (mask), GeoJSON, raster, window "column,row,width,height"; or a saved background.
    bands, nir : tuple of str
        Bands to use (empty: visible bands for "sea", else all or those of the saved background), and NIR bands (for
        "residual" and the water mask), by name or 1-based number.
    drop : int
        For "subspace": number of leading eigenvectors of the covariance that are left out.
    mask : str
        Where to score: "none" (everywhere), "water" (found in the scene), or a raster, GeoJSON file or window; "auto"
        is "water" for "sea", else "none". "sea" fills the holes of the mask at floating objects.
    pfa : float, optional
        Requested false-alarm rate per pixel. If neither it nor `false_per_km2` is given, there is no threshold.
    threshold : str
        How the threshold for `pfa` is found; one of `detect.threshold.THRESHOLDS`.
    false_per_km2 : float, optional
        For "sea": requested number of false objects per km2 of sea, instead of `pfa`.
    largest_object : (float, float)
        For "sea": length and width of the largest floating object [m].
    side : str
        For "sea": "bright" (brighter than the water), "both" (also darker), or "auto" (depends on the size of a pixel).
    moving : bool
        Whether to determine speed and heading of objects, from at least three bands that are not simultaneous.
    min_size, merge_distance : int, float
        Minimum size of an object, and distance within which parts are one object, as in `detect.objects.find` [pixel].
    """

    method: str = "auto"
    window: tuple[int, int] = (5, 21)
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
        known = {"method": ["auto", *DETECTORS], "threshold": THRESHOLDS, "side": ["auto", *SIDES], "border": BORDERS}
        for name, values in known.items():
            check_choice(getattr(self, name), list(values), name)
        check_rule(self.covariance, self.ridge)
        check_number(self.min_size, 1, math.inf, "min_size")
        check_number(self.merge_distance, 0, FARTHEST, "merge_distance")
        if self.pfa is not None and not 0 < self.pfa < 1:
            raise InputError(f"pfa: allowed is above 0 and below 1, got {self.pfa}.")
        method, rate = self.method, self.false_per_km2
        for owner, name in ((owner, name) for owner, kind in DETECTORS.items() for name in kind.options):
            if method != "auto" and name not in self.kind.options and getattr(self, name) != getattr(Recipe, name):
                said = f"--{name.replace('_', '-')} is for method {owner}, not {method}"
                raise InputError(f"{said}: leave it out, or take {owner}.")
        if self.kind.matrices is None and (self.background or self.covariance not in self.kind.covariances):
            raise InputError(
                f"{method} has a background of its own for every pixel: leave out --background; --covariance must be "
                f"{' or '.join(self.kind.covariances)}."
            )
        if self.ridge != RIDGE and self.covariance != "ridge":
            raise InputError("--ridge needs --covariance ridge: give both.")
        if rate is not None and not rate > 0:
            raise InputError(f"false-per-km2: allowed is above 0, got {rate}.")
        if rate is not None and self.pfa is not None:
            raise InputError("pfa and false-per-km2 both state the false-alarm rate: give one of them.")
        if rate is not None and self.threshold != "gpd":
            raise InputError("false-per-km2 sets the threshold: leave out --threshold, which is for --pfa.")
        if self.threshold in ("chi2", "f") and not self.kind.law and (method == "sea" or self.pfa is not None):
            raise InputError(f"{method} scores follow neither chi-squared nor F: take --threshold gpd or empirical.")

    @property
    def kind(self) -> Method:
        """Properties of the method, from `DETECTORS`; for "auto" those of "rx", which allows every output."""
        return DETECTORS["rx" if self.method == "auto" else self.method]

    @property
    def thresholded(self) -> bool:
        """Whether a threshold is requested."""
        return self.pfa is not None or self.false_per_km2 is not None


Recipe.__init__ = checked_keywords()(Recipe.__init__)  # type: ignore[method-assign]


@dataclass(frozen=True)
class Outputs:
    """Output files of `score_file`, and options for writing them."""

    image: Path  # raster of scores; the path of the sidecar has ".json" appended
    p_value: Path | None = None  # raster of p-values
    flags: Path | None = None  # raster of flags, the bits of `detect.pipeline.scoring.MEANINGS`
    objects: Path | None = None  # detected objects, GeoJSON or GeoPackage
    background: Path | None = None  # the fitted background
    overwrite: bool = False  # replace existing files
    options: Mapping[str, str] = field(default_factory=dict)  # GDAL creation options
    chips: Path | None = None  # folder for the pictures of the objects

    def check(self, recipe: Recipe) -> None:
        """Raise InputError if the recipe cannot produce an output, or if an extension or option is not allowed."""
        place = self.chips and next(p for p in (self.chips, *self.chips.parents) if p.exists())
        if self.objects and not recipe.thresholded:
            wanted = "--pfa, the accepted false alarms per pixel, such as 1e-4 (for sea also --false-per-km2)"
            raise InputError(f"objects need a threshold: give {wanted}.")
        if recipe.moving and not self.objects:
            raise InputError("--moving gives objects a speed and a heading: give --objects FILE, too.")
        if place and not place.is_dir():
            raise InputError(f"{place} (--chips) is a file: name a folder.")
        if place and not os.access(place, os.W_OK):
            raise InputError(f"no permission to write in {place} (--chips): name a folder.")
        if not self.objects and (recipe.min_size, recipe.merge_distance) != (Recipe.min_size, Recipe.merge_distance):
            raise InputError("--min-size and --merge-distance are for objects: give --objects FILE, too.")
        if self.chips and not self.objects:
            raise InputError("chips are pictures of objects: give --objects FILE, too.")
        if self.objects and self.objects.suffix.lower() not in SUFFIXES:
            raise InputError(f"{self.objects} (--objects): allowed are {', '.join(SUFFIXES)}.")
        if self.p_value and not recipe.kind.law:
            raise InputError(f"{recipe.method} scores have no known distribution: no p-values. Take --method rx.")
        if self.background and recipe.kind.matrices is None:
            remedy = "Leave out --save-background, or take --method rx"
            raise InputError(f"{recipe.method} has a background for every pixel, none to save. {remedy}.")

    @property
    def sidecar(self) -> Path:
        """Path of the sidecar: the path of the score raster with ".json" appended."""
        return self.image.parent / f"{self.image.name}.json"

    def every(self) -> list[Path]:
        """Paths of the files to check before the run; of the pictures in `chips` the first, if this folder exists."""
        style = self.objects.with_suffix(".qml") if self.objects and self.objects.suffix.lower() == ".gpkg" else None
        picture = self.chips / PICTURE.format(1) if self.chips and self.chips.is_dir() else None
        extra = (self.p_value, self.flags, self.objects, self.background, style, picture)
        return [self.image, self.sidecar, *(p for p in extra if p is not None)]
