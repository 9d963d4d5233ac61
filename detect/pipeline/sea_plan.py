"""How the sea of a scene is searched: which detector, which bands, which water, and what it looks like."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from deglint import tiles as tiling
from deglint.errors import BandError, DeglintError, NoWaterError
from deglint.masks import Roles, WaterRule
from deglint.pipeline.overview import role_bands
from deglint.readers.place import ground_area
from deglint.readers.roles import band_roles
from deglint.readers.text import read_json
from deglint.scene import Scene
from deglint.tiles import Tile

from .. import sea
from .recipe import WINDOW, Recipe

if TYPE_CHECKING:
    from .plan import Plan

_VISIBLE_RANGE = (400.0, 700.0)
"""Bands in which water is seen through a removed glint: the NIR is not corrected, and its glint is the clutter [nm]."""
_NIR = (740.0, 1100.0)
"""Bands that see glint and hardly any water [nm]."""
_MANY = 16
"""Bands from which on the spectrum alone tells a target, and a global covariance has the pixels to know it."""
_UNKNOWN = 10.0
"""Side of a pixel where the scene has no CRS [m]."""
_SAMPLE_BLOCK = 1024
"""Side of the blocks that the water is learnt from [pixel]."""
_BLOCKS = 4
"""How many of them hold enough water."""


@dataclass(frozen=True, eq=False)
class SeaPlan:
    """The sea of a scene.

    Attributes
    ----------
    rule : SeaRule
        What floats.
    area : float
        Of a pixel [m2]; NaN where the scene has no CRS.
    side : str or None
        As `detect.sea.fit`; None chooses by the pixels' size.
    model : SeaModel or None
        None until it is fitted.
    nir : tuple of int
        0-based NIR bands that tell how much glint a pixel has.
    """

    rule: sea.SeaRule
    area: float
    side: str | None = None
    model: sea.SeaModel | None = None
    nir: tuple[int, ...] = ()

    @property
    def pixel(self) -> float | None:
        """Side of a pixel [m], where it is known."""
        return self.rule.pixel if np.isfinite(self.area) else None

    @property
    def halo(self) -> int:
        """Pixels around a tile that its scores depend on."""
        return self.rule.halo + (self.model.halo if self.model else 0)


def plan_sea(scene: Scene, recipe: Recipe) -> SeaPlan:
    """Sizes of what may float on the sea of a scene."""
    known = ground_area(scene.transform, scene.crs, scene.height, scene.width)
    area = known or float("nan")
    pixel = float(np.sqrt(area)) if known else _UNKNOWN
    side = None if recipe.side == "auto" else recipe.side
    nir = tuple(i for i, b in enumerate(scene.bands) if b.wavelength is not None and _NIR[0] <= b.wavelength <= _NIR[1])
    return SeaPlan(sea.SeaRule(pixel, *recipe.largest_object), area, side, nir=nir)


def why_not_sea(scene: Scene, recipe: Recipe) -> str:
    """Why auto does not search the sea, before looking for water; "" where nothing speaks against it."""
    for name, usual in (("background", ""), ("covariance", "empirical"), ("window", WINDOW), ("drop", 1)):
        if getattr(recipe, name) != usual:
            return f"--{name} is an option of it"
    if recipe.threshold in ("chi2", "f"):
        return f"--threshold {recipe.threshold} is the law of its scores"
    count = len(recipe.bands or scene.bands)
    if count > _MANY:
        return f"{count} bands tell targets by their spectrum"
    return ""


def visible_bands(scene: Scene) -> tuple[int, ...]:
    """0-based visible bands, at least two; all bands where fewer are known."""
    low, high = _VISIBLE_RANGE
    found = [i for i, b in enumerate(scene.bands) if b.wavelength is not None and low <= b.wavelength <= high]
    if len(found) < 2:
        roles = band_roles(scene)
        found = sorted({i for r in ("blue", "green", "red") if (i := roles[r]) is not None})
    return tuple(found) if len(found) > 1 else tuple(range(len(scene.bands)))


def water_of_removal(scene: Scene, nir: int) -> tuple[WaterRule, tuple[int, ...]] | None:
    """The water that `deglint remove` found before it changed the visible bands, and the bands that it looked at.

    The NIR, which decides, is a copy of the input's. None where the scene is not the result of a removal.
    """
    found = band_roles(scene)
    bands = role_bands(Roles(nir=nir, **{k: v for k, v in found.items() if k != "nir" and v != nir}))
    try:
        numbers: dict[str, Any] = dict(read_json(f"{scene.path}.json", "sidecar")["water"])
        roles = Roles(**numbers.pop("roles"))
        rule = WaterRule(roles=roles, **{k: v for k, v in numbers.items() if k in WaterRule.__dataclass_fields__})
    except (DeglintError, KeyError, TypeError, ValueError):
        return None
    same = max(roles.nir, *roles.visible) < len(bands) and bands[roles.nir] == nir
    return (rule, bands) if rule.has_water and same else None


def read_sea(plan: Plan, tile: Tile, bands: Any) -> tuple[npt.NDArray[Any], npt.NDArray[np.uint8]]:
    """The pixels of a tile, and the class of each pixel (`detect.sea.region`)."""
    assert plan.sea is not None
    block = plan.scene.source.read(tile.window, list(bands))
    valid = np.asarray(np.isfinite(block).all(axis=0))
    mask = plan.mask.read(tile)
    water = valid if mask is None else np.logical_and(mask, valid)
    return block, sea.region(water, plan.sea.rule, valid)


def read_nir(plan: Plan, tile: Tile) -> npt.NDArray[Any]:
    """NIR of a tile, where scores are evened by it; else of no bands."""
    assert plan.sea is not None
    return plan.scene.source.read(tile.window, list(plan.sea.nir)) if plan.sea.nir else np.zeros((0, *tile.shape))


def fit_sea(plan: Plan) -> SeaPlan:
    """Learn the water from the scene, or of a large scene from some blocks with water.

    Raises
    ------
    NoWaterError
        There is no water to learn from.
    """
    assert plan.sea is not None
    scene, blocks, nir = plan.scene, [], []
    everything = tiling.tiles(scene.height, scene.width, (2 * _SAMPLE_BLOCK, 2 * _SAMPLE_BLOCK))
    if len(everything) > 1:
        everything = tiling.tiles(scene.height, scene.width, (_SAMPLE_BLOCK, _SAMPLE_BLOCK))
    few = _BLOCKS * _SAMPLE_BLOCK**2 // 2
    held = 0
    for tile in tiling.spread(everything, 16 * _BLOCKS * _SAMPLE_BLOCK**2):
        block, classes = read_sea(plan, tile, plan.bands)
        count = int(np.count_nonzero(classes == sea.WATER))
        if not count:
            continue
        blocks.append((block, classes))
        nir.append(read_nir(plan, tile))
        held += count
        if held >= few and len(blocks) >= _BLOCKS:
            break
    if not blocks:
        raise NoWaterError(f"no water in {scene.path} to compare with. Check --mask and --nodata, or take --method rx.")
    known = nir if plan.sea.nir else ()
    return replace(plan.sea, model=sea.fit(blocks, pixel=plan.sea.pixel, side=plan.sea.side, nir=known))


def explain(plan: Plan) -> list[str]:
    """What was decided, one line each."""
    found = plan.sea
    if found is None or found.model is None:
        return []
    size = f"{found.rule.pixel:.3g} m" if found.pixel else f"of unknown size, taken as {_UNKNOWN:g} m"
    what = "brighter or darker" if found.model.side == "both" else "brighter"
    scales = ", ".join(map(str, found.model.scales))
    even = ", over what is usual at the same NIR" if found.model.glint else ""
    floats = f"{found.rule.length:g} m by {found.rule.width:g} m"
    return [
        f"sea: water closed over what is up to {floats}; pixels {size}",
        f"sea: {what} than the water within {sea.SEA_WINDOW} pixels, at scales of {scales} pixels{even}",
    ]


def no_nir(error: BandError) -> str:
    """The reason that a missing NIR is."""
    return str(error).split(";", 1)[0].split(".", 1)[0]
