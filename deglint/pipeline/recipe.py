"""Options for processing a scene, the same as those of the command `deglint remove`, in an immutable object."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..checks import as_path, check_choice, check_kind, check_number, checked_keywords, nearest
from ..compensate import THESIS_CHAIN, parse
from ..errors import InputError
from ..readers.roles import explain_nir, find_band, find_nir, split_wanted
from ..remove import METHODS, NIR_USES, REGRESSIONS, FitRequest, nir_request
from ..scene import Scene

CHAINS = ("auto", "thesis", "off")  # names for chains of stages


@dataclass(frozen=True)
class Recipe:
    """Options for processing a scene; the defaults suit most. Raises InputError if one is wrong or two contradict.

    Attributes
    ----------
    method : str
        "auto" or a key of `deglint.remove.METHODS`.
    nir : tuple of str
        NIR bands by name or 1-based number (a single one also without a tuple); determined automatically if empty.
    nir_use : {"auto", "mean", "best", "set"}
        Which of several NIR bands predict the glint of a band: "mean", their mean; "best", the one that explains the
        band best; "set", the one taken at the same time. With "mean" or "best", wiener uses the first NIR. "auto" is
        "set" if `nir` is empty and the sensor takes its bands in sets at different times, each with a NIR; else "mean".
    bands : tuple of str
        Bands to correct, by name or 1-based number; if empty, all bands with a shorter wavelength than the NIR band of
        the longest wavelength (if no band but the NIR has a wavelength, all bands but the NIR).
    sample : str
        Pixels to fit to: "all", an area as in `mask`, or "auto". "auto" is the area that `mask` names, or else the open
        water that is found; if no water is found and `mask` is "none", it is all pixels.
    mask : str
        Pixels to correct: "auto" (water that is found), "none" (all valid pixels), or an area: the name of a mask
        raster or a GeoJSON file, or a window "column,row,width,height" [pixel].
    regression : str
        "auto" (detrended for an automatic sample, else ols) or a key of `deglint.remove.REGRESSIONS`.
    floor_percentile : float
        Percentile [%] that is the glint-free level: of the NIR (method hedley), or of the prediction from bands of
        longer wavelength (multiband). 0 means the minimum for hedley, 5 % for multiband. Other methods refuse it.
    rrs_factor : float
        Ratio of the physical values to remote-sensing reflectance [sr]; pi for reflectance.
    compensate : str
        "off" (no stages), "auto" (those of the chosen candidate if `method` is "auto", else none), "thesis", or a chain
        such as "identify-level:13, replace-level, remove"; see `STAGES` and `THESIS_CHAIN` in `deglint.compensate`.
    smallest_object : str
        Width of the smallest object to keep, such as "4m" or "16px"; if empty, 4 m (16 pixels for unknown pixel sizes).
    """

    method: str = "auto"
    nir: tuple[str, ...] = ()
    nir_use: str = "auto"
    bands: tuple[str, ...] = ()
    sample: str = "auto"
    mask: str = "auto"
    regression: str = "auto"
    floor_percentile: float = 0.0
    rrs_factor: float = float(np.pi)
    compensate: str = "auto"
    smallest_object: str = ""

    def __post_init__(self) -> None:
        for name in ("nir", "bands"):
            object.__setattr__(self, name, band_names(getattr(self, name), name))
        for name in ("sample", "mask"):
            value = getattr(self, name)
            text = ",".join(map(str, value)) if isinstance(value, (list, tuple)) else as_path(value, name)
            object.__setattr__(self, name, text)
        check_choice(self.method, ["auto", *METHODS], "method")
        check_choice(self.regression, ["auto", *REGRESSIONS], "regression")
        check_choice(self.nir_use, ["auto", *NIR_USES], "nir_use")
        check_number(self.floor_percentile, 0, 100, "floor_percentile")
        check_number(self.rrs_factor, 1e-6, 1e6, "rrs_factor")
        check_kind(self.compensate, str, "compensate", "Give 'auto', 'thesis', 'off' or a chain of stages.")
        check_kind(self.smallest_object, str, "smallest_object", "Give a width such as '4m' or '16px'.")
        for name in dict.fromkeys(option for method in METHODS.values() for option in method.options):
            owners = [key for key, method in METHODS.items() if name in method.options]
            if self.method not in owners and getattr(self, name) != getattr(Recipe, name):
                methods = f"method {' or '.join(owners)}, not {self.method}"
                raise InputError(f"--{name.replace('_', '-')} is for {methods}: leave it out, or change --method.")
        if self.smallest_object and self.chain != "auto":
            remedy = "leave out --smallest-object, or the others"
            raise InputError(f"--smallest-object needs --method auto and --compensate auto: {remedy}.")
        smallest_object(self.smallest_object, 1.0)  # raises InputError unless it is a width
        if self.compensate not in CHAINS:
            if hint := nearest(self.compensate, list(CHAINS)):
                raise InputError(f"compensate {self.compensate!r} is not one of {', '.join(CHAINS)}, nor a stage{hint}")
            parse(self.compensate)

    @property
    def chain(self) -> str:
        """Chain of stages as text; "auto" if a candidate is to be chosen on the scene, "off" for no stages."""
        if self.compensate == "auto":
            return "auto" if self.method == "auto" else "off"
        return THESIS_CHAIN if self.compensate == "thesis" else self.compensate


Recipe.__init__ = checked_keywords()(Recipe.__init__)  # type: ignore[method-assign]


def band_names(value: str | int | Sequence[str | int], field: str) -> tuple[str, ...]:
    """Names and 1-based numbers of bands, from text ("NIR1, NIR2"), number or list; error messages name `field`."""
    try:
        return tuple(map(str, split_wanted(value)))
    except InputError as error:
        raise InputError(f"{field}: {error}") from None


def make_request(scene: Scene, recipe: Recipe) -> tuple[FitRequest, str]:
    """Make the request for a fit, and a log line on the choice of NIR bands. Raises InputError for unusable bands."""
    wanted = list(recipe.nir) or None
    nir, note = find_nir(scene, wanted), explain_nir(scene, wanted)
    use = "mean" if recipe.nir_use == "auto" else recipe.nir_use
    if recipe.nir_use == "auto" and not wanted and (sets := _nir_of_every_set(scene)):
        nir, use = sets, "set"
        names = " and ".join(scene.bands[b].name for b in nir)
        note = f"NIR is {names}, each for the bands taken at the same time (--nir-use mean to average)"
    correct = [find_band(scene, b) for b in recipe.bands] or None
    if set(correct or range(len(scene.bands))) <= set(nir):
        raise InputError("only the NIR is left to correct: choose other bands (-b), or stack visible bands with it.")
    same = {"floor_percentile": recipe.floor_percentile, "rrs_factor": recipe.rrs_factor}
    return nir_request(scene.bands, nir, use=use, correct=correct, **same), note


def _nir_of_every_set(scene: Scene) -> tuple[int, ...]:
    """0-based NIR band of each set of simultaneous bands; empty unless there are 2 or more sets, each with a NIR."""
    groups = list(dict.fromkeys(b.group for b in scene.bands))
    if None in groups or len(groups) < 2:
        return ()
    nir = [(i, b) for i, b in enumerate(scene.bands) if b.wavelength and 750 <= b.wavelength <= 1050]
    inside = [[(abs((b.wavelength or 0) - 842.0), i) for i, b in nir if b.group == group] for group in groups]
    return tuple(min(some)[1] for some in inside) if all(inside) else ()


SMALLEST_OBJECT = 4.0
"""Default width of the smallest object to keep: a boat, a person with raised arms seen from above, a buoy [m]."""
UNKNOWN_OBJECT = 16.0  # default width of the smallest object if the pixel size is not known [pixel]


def smallest_object(text: str | None, pixel: float | None) -> float:
    """Width of the smallest object to keep [pixel], from text such as "4m" or "16px"; without a unit it is in metres.

    `pixel` is the pixel size [m], None if not known. Without text the width is 4 m, or 16 pixels if `pixel` is None.
    Raises InputError if the text is not a length, or is in metres and `pixel` is None.
    """
    if not text:
        return UNKNOWN_OBJECT if pixel is None else SMALLEST_OBJECT / pixel
    match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(px|pixels?|m|metres?|meters?)?\s*", text)
    if not (match and 0 < float(match[1]) < 1e6):
        raise InputError(f"--smallest-object {text!r} is not a width such as 4m or 16px.")
    if (match[2] or "m").startswith("p"):
        return float(match[1])
    if pixel is None:
        raise InputError(f"--smallest-object {text}: the size of a pixel is not known; give pixels, such as 16px.")
    return float(match[1]) / pixel
