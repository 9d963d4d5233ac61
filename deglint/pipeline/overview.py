"""Tiles of a scene that are read for a fit: overviews, in which water is found, and tiles that contain the sample."""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from .. import tiles as tiling
from ..errors import FitError, NoWaterError
from ..masks import Roles, WaterRule, deep_water, fit_sample, fit_water
from ..masks.find import COARSE_PIXEL
from ..moments import Mask
from ..raster import RasterSource
from ..readers.areas import open_area, tile_area
from ..readers.grid import pixel_size
from ..readers.roles import RED_EDGE, band_roles
from ..remove import FitRequest
from ..remove.wiener import SAMPLE_SIDE
from ..scene import FloatArray, Scene
from ..tiles import T, Tile
from .recipe import Recipe

Progress = Callable[[str, int, int], None]  # called with the name of a step, and the numbers of finished and all tiles
Work = Callable[[Tile], T]
Note = Callable[[int, int], None]  # called with the numbers of finished and of all tiles
OVERVIEW_PIXELS = 300_000  # approximate number of pixels in the first overview
SMALL_PIXELS = 600_000  # scenes of up to this number of pixels are read as a whole from the start
FRAME_PIXELS = 2_100_000  # the same at fine pixels (a frame of a drone), where glint may be dense in a small part
LEAST_VALID = OVERVIEW_PIXELS // 4  # an overview with fewer valid pixels (about 2 of its 8 tiles) is skipped
TILE_SIDE = SAMPLE_SIDE  # side of the tiles of an overview [pixel]: the same for every file, independent of its blocks
MOST_OVERVIEW = 16 << 20
"""Most pixels that the overview of a whole scene keeps in memory. A larger scene is read completely, and only some of
the tiles with valid pixels are kept."""
MOST_TILES = 1 << 18  # most tiles that are considered for an overview


@dataclass(frozen=True)
class Overview:
    """Tiles spread over a scene, or all its tiles, that are read before a fit; and the rule of the water in them."""

    tiles: tuple[Tile, ...]  # tiles that were read and hold valid pixels
    bands: tuple[int, ...]  # 0-based scene bands that the masks use (visible and NIR), in ascending order
    water: WaterRule | None  # None if it was not requested, or if no band below 750 nm is known
    whole: bool  # the overview covers the whole scene


def overviews(scene: Scene, nir: int, threads: int, *, wanted: bool) -> Iterator[Overview]:
    """Yield overviews of larger and larger parts of a scene; the last is of the whole scene. If `wanted` is True, water
    is searched for in each, and parts with few valid pixels (`LEAST_VALID`) are skipped, except the whole scene.
    Raises NoWaterError if a scene of more than `MOST_OVERVIEW` pixels has no valid pixel in the 0-based band `nir`.
    """
    roles, bands = roles_of(scene, nir)
    total = scene.height * scene.width
    reflectance = (scene.sensor or "").startswith(("sentinel2", "landsat")) or all(
        re.fullmatch(r"(sr_)?b(0\d|1\d|8a)", name.lower()) for name in scene.names
    )
    small = FRAME_PIXELS if (pixel_size(scene) or 0.0) < COARSE_PIXEL else SMALL_PIXELS
    for pixels in (OVERVIEW_PIXELS, 16 * OVERVIEW_PIXELS, total) if total > small else (total,):
        last = pixels >= total
        chosen = _everywhere(scene, nir, threads) if last else _lattice(scene, pixels)
        rule = None
        if wanted and roles.visible and chosen:
            blocks = read_tiles(scene, chosen, bands, threads)
            valid = [int(np.isfinite(block[roles.nir]).sum()) for block in blocks]
            if not last and sum(valid) < LEAST_VALID:
                continue
            chosen = [tile for tile, some in zip(chosen, valid, strict=True) if some] or chosen
            whole = last and total <= MOST_OVERVIEW
            rule = fit_water(blocks, roles, pixel=pixel_size(scene), whole=whole, reflectance=reflectance)
        elif not chosen:
            raise NoWaterError(f"{scene.path}: band {scene.bands[nir].name} has no valid pixel. Check it and --nodata.")
        yield Overview(tuple(chosen), bands, rule, last)


def roles_of(scene: Scene, nir: int) -> tuple[Roles, tuple[int, ...]]:
    """Bands that the masks use: their roles, as indices into a block of only these bands; their 0-based scene bands."""
    visible = {role: band for role, band in band_roles(scene).items() if role in ("blue", "green", "red")}
    found = {role: band for role, band in visible.items() if band not in (None, nir)}
    edge = [(b.wavelength, i) for i, b in enumerate(scene.bands) if i != nir and (b.wavelength or RED_EDGE) < RED_EDGE]
    found = (found or ({"red": min(edge)[1]} if edge else {})) | {"nir": nir}  # over water, red edge exceeds NIR, too
    bands = tuple(sorted(found.values()))
    return Roles(**{role: bands.index(band) for role, band in found.items()}), bands


def _lattice(scene: Scene, pixels: int) -> list[Tile]:
    """Tiles spread evenly over a scene, with about `pixels` pixels in all, chosen from at most about 260,000 tiles."""
    side = TILE_SIDE * max(1, math.isqrt(scene.height * scene.width // (TILE_SIDE**2 * MOST_TILES)))
    corners = [tile.split(TILE_SIDE)[0] for tile in tiling.tiles(scene.height, scene.width, (side, side))]
    return tiling.spread(corners, pixels)


def _everywhere(scene: Scene, nir: int, threads: int) -> list[Tile]:
    """All tiles of a scene; if they need too much memory, some of those with valid pixels in the 0-based band `nir`."""
    total = scene.height * scene.width
    if total <= MOST_OVERVIEW:
        return tiling.tiles(scene.height, scene.width, (TILE_SIDE, TILE_SIDE))
    shape = tile_shape_of(scene)

    def work(tile: Tile) -> list[Tile]:
        valid = np.isfinite(scene.source.read(tile.window, [nir])[0])
        return [t for t in tile.split(TILE_SIDE) if valid[t.within(tile)].any()]

    at_once = tiling.affordable(threads, shape, len(scene.bands))
    everything = tiling.tiles(scene.height, scene.width, shape)
    # only one tile in `share` is kept from the start: the list itself must not grow with the scene
    share = max(1, total // (TILE_SIDE**2 * MOST_TILES))
    found = [t for part in on_threads(everything, work, at_once) for t in part[::share]]
    return found[:: max(1, -(-len(found) * TILE_SIDE**2 // MOST_OVERVIEW))]


def overview_of(scene: Scene, nir: int, threads: int) -> Overview:
    """The first overview with water, else the last; if no band below 750 nm is known, the first. `nir` is 0-based."""
    for overview in overviews(scene, nir, threads, wanted=True):
        if overview.water is None or overview.water.has_water:
            break
    return overview


def raster_of(scene: Scene) -> RasterSource:
    """The source of a scene as a `RasterSource`, which has all properties of the file; its type is not checked."""
    return cast(RasterSource, scene.source)


def on_threads(tiles: Sequence[Tile], work: Work[T], threads: int, progress: Note | None = None) -> Iterator[T]:
    """Iterate over the results of `work(tile)`, in the order of the tiles; arguments are as in `tiles.run`."""
    return (done for _t, done in tiling.run(tiles, work, threads=threads, progress=progress))


def read_tiles(scene: Scene, tiles: Sequence[Tile], bands: Sequence[int], threads: int) -> list[FloatArray]:
    """Physical values (band, row, column) of each tile; `bands` are 0-based."""
    return list(on_threads(tiles, lambda tile: scene.source.read(tile.window, list(bands)), threads))


def block_of(scene: Scene) -> tuple[int, int]:
    """Rows and columns of the blocks in the scene's file."""
    return raster_of(scene).info.block_shapes[0]


def tile_shape_of(scene: Scene) -> tuple[int, int]:
    """Rows and columns of the tiles in which the scene is processed."""
    return tiling.tile_shape(scene.height, scene.width, len(scene.bands), block_of(scene))


@dataclass(frozen=True)
class Sampler:
    """Where the sample of a scene lies: tiles that contain it, and a function that returns its mask in a tile."""

    tiles: Sequence[Tile]  # tiles that contain the sample
    squares: Sequence[Tile]  # the same area in squares of at most `TILE_SIDE` pixels; they do not depend on file blocks
    mask: Callable[[FloatArray, Tile], Mask]  # mask of the sample (row, column) from a block of `bands` and its tile
    bands: tuple[int, ...] = ()  # 0-based bands that `mask` needs
    halo: int = 0  # pixels around a tile that `mask` needs
    numbers: dict[str, object] = field(default_factory=dict)  # entries of the sidecar
    bounds: Tile | None = None  # tile around the sample, if the user has given one


@dataclass(frozen=True)
class Job:
    """Scene, options and threads of a fit that uses one overview of the scene."""

    scene: Scene
    recipe: Recipe
    request: FitRequest
    overview: Overview
    threads: int
    note: Note | None  # called with the numbers of finished tiles and of all tiles
    run: tiling.RunTiles  # function that processes tiles
    want_sample: bool  # return the outline of the sample
    sampler: Sampler | None = None  # for the sample that the recipe selects; None if that is "auto"

    def results(self, tiles: Sequence[Tile], work: Work[T], halo: int = 0, note: Note | None = None) -> Iterator[T]:
        """Iterate over results of `work(tile)` in tile order, on as many of the job's threads as memory allows.
        `halo`: margin that `work` reads around a tile [pixel]; `note`: called with numbers of finished and all tiles.
        """
        at_once = tiling.affordable(self.threads, (TILE_SIDE + 2 * halo,) * 2, 2 * len(self.scene.bands))
        return on_threads(tiles, work, at_once, note)


def sampler_of(job: Job) -> Sampler:
    """Make the `Sampler` for the sample that the recipe of a job requests.
    Raises FitError if no sample is found, and the errors of `open_area` if the given sample cannot be used.
    """
    scene, sample, overview = job.scene, job.recipe.sample, job.overview
    if sample == "auto":
        if overview.water is None:
            raise FitError(
                "no band below 750 nm is known, so that a sample cannot be found. Pass --sample FILE.geojson, "
                "a window, or --sample all."
            )
        rule = fit_sample(read_tiles(scene, overview.tiles, overview.bands, job.threads), overview.water)
        numbers = {"rule": rule.numbers(), "tiles": len(overview.tiles)}
        places = overview.tiles, overview.tiles
        return Sampler(*places, lambda block, _tile: deep_water(block, rule), overview.bands, rule.halo, numbers)
    area = tile_area(Tile(0, scene.height, 0, scene.width))
    if sample != "all":
        # the area of --mask is also the sample, if no other sample is given
        area = open_area(sample, scene, "--mask" if sample == job.recipe.mask else "--sample")
    numbers = {"crs": area.note} if area.note else {}
    shapes = tile_shape_of(scene), (TILE_SIDE, TILE_SIDE)
    tiles, squares = (tiles_over(scene, area.bounds, shape) for shape in shapes)
    return Sampler(tiles, squares, lambda _block, tile: area.read(tile.window), numbers=numbers, bounds=area.bounds)


def tiles_over(scene: Scene, bounds: Tile, shape: tuple[int, int]) -> list[Tile]:
    """Tiles of this shape (rows, columns) [pixel] that overlap with the tile `bounds`."""
    return [t for t in tiling.tiles(scene.height, scene.width, shape) if min(t.clipped(bounds).shape) > 0]
