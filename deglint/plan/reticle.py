"""The reticle: light, glint, reflected sky and contrast for every viewing geometry, and which of these are excluded.

The radiance of a band is the mean of its spectrum in steps of 1 nm. The model of the water is a sum of a few spectra,
each multiplied by a function of the angles, so each spectrum is averaged once for all viewing geometries. Sums do not
call BLAS, whose threads block each other for seconds on a busy machine.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..errors import BandError
from ..moments import Mask
from ..physics import atmosphere, glint, sun, water
from ..physics._checks import Floats
from ..physics.iops import Iops, case1
from ..physics.sensor import band_means, electrons, noise_equivalent_radiance
from .mission import Mission
from .skylight import Skylight

MARGIN = 3.0  # least angle between the best viewing geometry and any excluded one, where possible [degree]
_POINTS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
_CARDINAL = {"N": "north", "E": "east", "S": "south", "W": "west"}
_AROUND = 16  # number of points at `MARGIN` around the best viewing geometry; if possible, none of them is excluded


class Illumination:
    """Irradiance and water-leaving radiance in each band, for zenith angles and azimuths of the sensor [degree].

    Irradiances are (band,) [W m-2 nm-1], radiances (band, zenith, azimuth) [W m-2 sr-1 nm-1]. The model of deep water
    is Lee et al. (2011); beyond its table (sun zenith angle 75, view zenith angle 70 degrees) the coefficients at the
    edge are used. The model of the object is `water.submerged_reflectance` or `water.absorption_only_reflectance`.
    """

    def __init__(self, mission: Mission, zenith: Floats, azimuth: Floats) -> None:
        wavelength, mean = band_means(mission.channels)
        sun_zenith, sun_azimuth = mission.sun
        direct, diffuse = atmosphere.irradiance(wavelength, sun_zenith, mission.weather, day=mission.day)
        self.direct, self.diffuse = mean(direct), mean(diffuse)  # irradiance of a horizontal plane by sun and sky
        self.normal = self.direct / np.cos(np.radians(sun_zenith))  # irradiance by the sun, of a plane facing it
        sea = case1(wavelength, mission.chlorophyll)
        terms = [term * (direct + diffuse) for term in water.lee_2011_terms(sea)]
        angular = water.lee_2011(sun_zenith, zenith[:, None], azimuth - sun_azimuth)
        # water-leaving radiance: `background` of deep water, `target` over the object
        self.background = np.einsum("tb,tza->bza", [mean(term) for term in terms], angular)
        kept, shine = _over_object(mission, sea, zenith, direct / (direct + diffuse))
        self.target = np.einsum("tbz,tza->bza", [mean(term[:, None] * kept) for term in terms], angular)
        self.target += mean(shine * (direct + diffuse)[:, None])[..., None]


class Reticle:
    """Radiances, contrasts and masks of a mission for every viewing geometry: (zenith, azimuth) if no shape is given.

    Attributes
    ----------
    mission, light : Mission, Illumination
        Parameters of the plan; its irradiances and water-leaving radiances.
    bands : tuple of str
        Names of the bands.
    zenith, azimuth : (zenith,) and (azimuth,) ndarray
        Direction of the sensor as seen from the object [degree]; azimuths include both 0 and 360.
    glint_probability : ndarray
        Share of the sea that reflects the solar disk, or a disk of the radius `Limits.tolerance` if given [1].
    glint_strength : ndarray
        Glint radiance per irradiance of a plane facing the sun [1/sr].
    sky_strength : ndarray
        Reflected skylight per diffuse irradiance [1/sr].
    glint_radiance, sky_radiance : (band, zenith, azimuth) ndarray
        Radiance of sun glint, and of reflected skylight [W m-2 sr-1 nm-1].
    sky_probability : (band, zenith, azimuth) ndarray
        Share of the sea that reflects more skylight than `Limits.sky_ratio` times the radiance of deep water [1].
    weber, snr : (band, zenith, azimuth) ndarray
        Weber contrast ``(LT - LB) / LB`` and contrast over noise ``|LT - LB| / NER`` [1]. Water-leaving radiance is LT
        over the object and LB in deep water. Noise-equivalent radiance NER is by default that of LB + glint + sky.
    clear_of_glint : bool ndarray
        True where sun glint is within its limits.
    clear_of_sky, detectable : (band, zenith, azimuth) bool ndarray
        `clear_of_sky` is True where reflected sky is within its limit; `detectable` is True where the contrast over
        noise exceeds its limit and neither object nor water saturates the sensor.
    excluded : bool ndarray
        True where no band is usable. A band is usable where all three masks above are True.
    by_band, combined : (band, zenith, azimuth) and (zenith, azimuth) ndarray
        `by_band` is the contrast over noise of each band [1], 0 where it is not usable (Fink 2014, section 2.7.4);
        `combined` is that of all bands together, the root of the sum of the squares of `by_band`.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission, limits, wind = mission, mission.limits, mission.slope_wind
        self.bands = tuple(b.name for b in mission.channels)
        self.zenith = np.linspace(0.0, mission.widest, round(mission.widest / mission.step) + 1)
        self.azimuth = np.linspace(0.0, 360.0, round(360.0 / mission.step) + 1)
        self.light = light = Illumination(mission, self.zenith, self.azimuth)
        disk = sun.solid_angle(mission.day) if limits.tolerance is None else glint.cone(limits.tolerance)
        spark = glint.sun_glint(*mission.sun, self.zenith[:, None], self.azimuth, **wind.options)
        share = glint.probability(spark.density, self.zenith[:, None], spark.tilt, disk)
        self.glint_probability, self.glint_strength = np.minimum(share, 1.0), spark.radiance
        self.clear_of_glint: Mask = spark.radiance <= limits.glint
        if limits.glint_probability is not None:
            self.clear_of_glint &= share <= limits.glint_probability
        mirrored = Skylight(self.zenith, self.azimuth, mission.sun, wind, model=mission.sky)
        self.sky_strength = mirrored.mean
        ratio = (limits.sky_ratio / light.diffuse)[:, None, None] * light.background
        self.sky_probability = mirrored.share_above(ratio)
        self.clear_of_sky: Mask = self.sky_probability <= limits.sky_probability
        self.glint_radiance = np.asarray(light.normal[:, None, None] * self.glint_strength)
        self.sky_radiance = np.asarray(light.diffuse[:, None, None] * self.sky_strength)
        rest = self.glint_radiance + self.sky_radiance
        self.weber = light.target / light.background - 1.0
        pairs = zip(light.background + rest, mission.channels, strict=True)
        noise = np.stack([noise_equivalent_radiance(layer, mission.sensor, band) for layer, band in pairs])
        self.snr = np.abs(light.target - light.background) / (noise if limits.ner is None else limits.ner)
        brightest = np.array([b.full_scale for b in mission.channels])[:, None, None]
        below = np.maximum(light.background, light.target) + rest < brightest
        self.detectable: Mask = (self.snr > limits.snr) & below
        usable = self.clear_of_glint & self.clear_of_sky & self.detectable
        self.excluded: Mask = ~usable.any(axis=0)
        self.by_band = np.asarray(self.snr * usable)
        self.combined = np.sqrt(np.sum(np.square(self.by_band), axis=0))

    def __repr__(self) -> str:
        return f"Reticle({self.mission!r})"

    def index(self, band: str) -> int:
        """Index of a band on the band axis of the arrays. Raises BandError if the plan does not use this band."""
        name = self.mission.sensor.band(band).name
        if name not in self.bands:
            raise BandError(f"band {name} is not in this plan ({', '.join(self.bands)}). Add {name} with -b.")
        return self.bands.index(name)

    def nearest(self, zenith: float, azimuth: float) -> tuple[int, int]:
        """Indices (zenith, azimuth) of the viewing geometry nearest to a zenith angle and an azimuth [degree]."""
        return int(np.argmin(np.abs(self.zenith - zenith))), int(np.argmin(np.abs(self.azimuth - azimuth)))

    def counts(self) -> dict[str, Floats]:
        """Electrons per pixel, (band, zenith, azimuth), by source of the light (Fink 2014, eq. 2.23).

        Keys are "background" (deep water), "object" (water over the object), "sky" and "glint".
        """
        parts = {"background": self.light.background, "object": self.light.target}
        parts |= {"sky": self.sky_radiance, "glint": self.glint_radiance}
        sensor, bands = self.mission.sensor, self.mission.channels
        return {
            name: np.stack([electrons(layer, sensor, band) for layer, band in zip(part, bands, strict=True)])
            for name, part in parts.items()
        }


def reticle(mission: Mission) -> Reticle:
    """Compute light, glint, reflected sky and contrast of a mission for every viewing geometry (the reticle).

    Returns
    -------
    Reticle
        Zenith angles 0 to `mission.widest` and azimuths 0 to 360, in steps of `mission.step` [degree].

    References
    ----------
    Fink (2014), "Glint avoidance and removal in the maritime environment", Rochester Institute of Technology,
    chapter 2: eq. 2.22 to 2.31; here, the sums over facets of the sea are in closed form.

    Examples
    --------
    >>> from deglint.plan import Mission
    >>> plan = reticle(Mission(sun_zenith=20.5, sun_azimuth=270.2, wind=9.0, wind_height=12.5, step=5.0))
    >>> float(plan.glint_strength[0, 0].round(5))
    0.01571
    """
    return Reticle(mission)


def _over_object(mission: Mission, sea: Iops, zenith: Floats, direct_fraction: Floats) -> tuple[Floats, Floats]:
    """Coefficients a [1] and b [1/sr]: the reflectance over the object is a times that of deep water, plus b.

    Both are (wavelength, zenith of the sensor). `direct_fraction` (wavelength,) is direct over total irradiance.
    """
    column = Iops(*(np.asarray(part)[:, None] for part in sea))
    angles, albedo = (mission.sun[0], zenith), mission.reflectance
    given: dict[str, npt.ArrayLike] = {"depth": mission.depth, "direct_fraction": direct_fraction[:, None]}
    if mission.water == "absorption":
        shine = water.absorption_only_reflectance(column, *angles, reflectance=albedo, **given)
        return np.ones_like(shine), shine
    # the reflectance over an object is a linear function of the reflectance of deep water: its slope, its constant
    kept = water.submerged_reflectance(column, 1.0, *angles, reflectance=0.0, **given)
    return kept, water.submerged_reflectance(column, 0.0, *angles, reflectance=albedo, **given)


@dataclass(frozen=True)
class ViewingGeometry:
    """A direction from which the sensor sees the object, with the contrast and the glint there."""

    zenith: float  # zenith angle of the sensor, seen from the object [degree]
    azimuth: float  # azimuth of the sensor, seen from the object [degree]
    contrast: float  # contrast over noise, all usable bands together [1]
    bands: tuple[str, ...]  # usable bands, the band with the highest contrast first
    glint: float  # glint radiance per irradiance of a plane facing the sun [1/sr]
    glint_probability: float  # share of the sea that mirrors the sun [1]
    margin: bool  # True if no excluded viewing geometry lies within `MARGIN`

    @property
    def heading(self) -> float:
        """Azimuth in which the sensor looks, towards the object [degree]."""
        return (self.azimuth + 180.0) % 360.0


def best_geometry(plan: Reticle, contrast: Floats | None = None, *, band: str | None = None) -> ViewingGeometry | None:
    """The viewing geometry with the highest contrast; None if all are excluded.

    If possible, no viewing geometry within `MARGIN` [degree] of the selected one is excluded. `contrast` (zenith,
    azimuth) is contrast over noise [1], 0 where excluded; by default it is that of the band with the name `band`, or of
    all bands together. Raises BandError if the plan has no such band.
    """
    bands = list(range(len(plan.bands))) if band is None else [plan.index(band)]
    if contrast is None:
        contrast = plan.combined if band is None else plan.by_band[bands[0]]
    good = contrast > 0
    if not good.any():
        return None
    safe = good & good[_ring(good.shape, plan.mission.widest)].all(axis=0)
    has_margin = bool(safe.any())
    chosen = np.where(safe if has_margin else good, contrast, -1.0)
    i, j = np.unravel_index(int(np.argmax(chosen)), chosen.shape)
    usable = sorted((k for k in bands if plan.by_band[k, i, j] > 0), key=lambda k: -plan.by_band[k, i, j])
    return ViewingGeometry(
        zenith=float(plan.zenith[i]),
        azimuth=float(plan.azimuth[j]) % 360.0 if i else 0.0,
        contrast=float(contrast[i, j]),
        bands=tuple(plan.bands[k] for k in usable),
        glint=float(plan.glint_strength[i, j]),
        glint_probability=float(plan.glint_probability[i, j]),
        margin=has_margin,
    )


def description(geometry: ViewingGeometry | None) -> str:
    """Text that says from where to look, and which contrast and glint to expect; for None, that no geometry is good."""
    return sentence(geometry) if geometry is None else f"{sentence(geometry)} {quality(geometry)}"


def sentence(geometry: ViewingGeometry | None) -> str:
    """Sentence that says from where to look; for None, that no viewing geometry is good.

    >>> sentence(ViewingGeometry(24.0, 225.0, 41.2, ("BLUE", "GREEN"), 1e-4, 3.2e-7, True))
    'Look from the south-west (azimuth 225), 24 degrees off nadir, towards 045.'
    """
    if geometry is None:
        return "No viewing geometry is good: sun glint, mirrored sky, noise or saturation spoils every one."
    if geometry.zenith < 1.0:
        return "Look straight down."
    where = f"{compass(geometry.azimuth)} (azimuth {geometry.azimuth:03.0f})"
    return f"Look from the {where}, {geometry.zenith:.0f} degrees off nadir, towards {geometry.heading:03.0f}."


def quality(geometry: ViewingGeometry) -> str:
    """Text that states contrast and glint of a viewing geometry, and warns if excluded viewing geometries are near."""
    stand = "" if geometry.zenith < 1.0 else f"Ground distance {np.tan(np.radians(geometry.zenith)):.2f} x altitude. "
    edge = "" if geometry.margin else f" An excluded viewing geometry is within {MARGIN:g} degrees."
    return (
        f"{stand}Contrast {geometry.contrast:.3g} x noise in {', '.join(geometry.bands[:4])}."
        f" Sun glint on {one_in(geometry.glint_probability)} of the sea.{edge}"
    )


def one_in(share: float) -> str:
    """Convert a share [1] to text: 3.1e-6 to "1 in 320 000", but 0.1 to "10 %"."""
    if share < 1e-9:
        return "less than 1 in a billion"
    if share > 0.05:
        return f"{100 * share:.0f} %"
    return f"1 in {float(f'{1 / share:.2g}'):,.0f}".replace(",", " ")


def compass(azimuth: float) -> str:
    """Name of the compass point nearest to an azimuth [degree].

    >>> compass(225.0)
    'south-west'
    """
    return "-".join(_CARDINAL[letter] for letter in _POINTS[round(azimuth / 22.5) % 16])


@lru_cache(maxsize=4)
def _ring(shape: tuple[int, int], widest: float) -> tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]:
    """Indices of zenith angle and of azimuth of `_AROUND` points at an angle of `MARGIN` from each viewing geometry.

    Both arrays are (point, zenith, azimuth). `shape` is the number of zenith angles and of azimuths, `widest` the
    largest zenith angle [degree]. Points outside the reticle are moved to its edge.
    """
    zenith = np.radians(np.linspace(0.0, widest, shape[0]))[:, None]
    azimuth = np.radians(np.linspace(0.0, 360.0, shape[1]))
    turn = np.arange(_AROUND)[:, None, None] * (2.0 * np.pi / _AROUND)
    away = np.radians(MARGIN)
    cosine = np.cos(zenith) * np.cos(away) - np.sin(zenith) * np.sin(away) * np.cos(turn)
    to = np.arccos(np.clip(cosine, -1.0, 1.0))
    out = np.cos(away) * np.sin(zenith) + np.sin(away) * np.cos(zenith) * np.cos(turn)
    side = np.arctan2(np.sin(turn) * np.sin(away), out)
    i = np.clip(np.rint(np.degrees(to) / widest * (shape[0] - 1)), 0, shape[0] - 1).astype(np.int32)
    j = np.rint(np.degrees(azimuth + side) % 360.0 / 360.0 * (shape[1] - 1)).astype(np.int32)
    return i, np.broadcast_to(j, (_AROUND, *shape))
