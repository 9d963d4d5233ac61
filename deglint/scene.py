"""A scene: its bands, size and georeferencing, and a method to read windows of it.

A `Scene` is frozen and reads no pixels until `Scene.read` is called. Arrays are (band, row, column), floating point, in
physical units (scale and offset applied), with NaN where a pixel is not valid. File formats are dealt with elsewhere:
`deglint.readers` makes scenes, `deglint.raster` reads their pixels.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt
from affine import Affine

from .errors import BandError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROUNDED = 0.999  # share of `Band.saturation` from which pixels count as saturated: values are rounded
FloatArray = npt.NDArray[np.floating[Any]]
Window = tuple[tuple[int, int], tuple[int, int]]  # ((first row, last row + 1), (first column, last column + 1))


@dataclass(frozen=True, slots=True)
class Band:
    """One band of a scene.

    Attributes
    ----------
    name : str
        Name as the file or sensor gives it ("B08", "NIR1"), or "band N".
    wavelength : float, optional
        Centre wavelength [nm].
    width : float, optional
        Full width at half maximum [nm].
    time_offset : float, optional
        Time of the band after the first band [s].
    group : str, optional
        Name of a group; bands of the same group are recorded at (nearly) the same time.
    saturation : float, optional
        Smallest physical value at which the band is saturated.
    """

    name: str
    wavelength: float | None = None
    width: float | None = None
    time_offset: float | None = None
    group: str | None = None
    saturation: float | None = None


def image_bands(bands: Sequence[Band], nir: Collection[int]) -> list[int]:
    """0-based bands that are images: `nir`, and bands with a wavelength (all, if no other has); others are classes."""
    unknown = not any(b.wavelength for i, b in enumerate(bands) if i not in nir)
    return [i for i, b in enumerate(bands) if unknown or b.wavelength or i in nir]


class Source(Protocol):
    """Protocol of objects that read the pixels of a scene (made by `deglint.raster`; thread-safe)."""

    def read(self, window: Window, bands: Sequence[int]) -> FloatArray:
        """Physical values of 0-based bands in a window of the scene, (band, row, column); NaN where not valid."""
        ...


@dataclass(frozen=True)
class Scene:
    """A multispectral image of which pixels are only read when they are needed.

    Attributes
    ----------
    bands : tuple of Band
        In file order.
    height, width : int
        Rows and columns [pixel].
    source : Source
        Reads the pixels.
    path : str
        GDAL name(s) of what was opened, for messages and the sidecar.
    crs, transform
        Coordinate reference system and affine transform, as rasterio gives them; None where not known.
    sensor : str, optional
        Name of the sensor preset that was used.
    product : str, optional
        Kind and name of the product that was opened, or of several ("Sentinel-2 L2A S2A ...").
    notes : tuple of str
        Conclusions drawn on opening, one line each, for the log.
    footprints : Source, optional
        Detector number of each band at each pixel, NaN for pixels without a detector, if the product has it
        (Sentinel-2): ``read(window, bands)`` gives (band, row, column) float32.
    """

    bands: tuple[Band, ...]
    height: int
    width: int
    source: Source = field(repr=False)
    path: str = ""
    crs: Any = None
    transform: "Affine | None" = None
    sensor: str | None = None
    notes: tuple[str, ...] = ()
    product: str | None = None
    footprints: Source | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        sensor = f", sensor {self.sensor}" if self.sensor else ""
        return f"Scene({self.path!r}, {len(self.bands)} bands, {self.width} x {self.height} pixels{sensor})"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the scene in natural colours; glint, clouds and foam are white. Needs matplotlib.

        `ax` is the matplotlib Axes to draw in, by default those of a new figure; they are returned. Raises InputError
        if matplotlib is not installed, ReadError if the file cannot be read.
        """
        from .plotting import drawn

        return drawn([self], ax, "Scene.plot")

    def rgb(self, among: Sequence[int]) -> list[int]:
        """0-based indexes of those bands in `among` whose wavelengths are nearest to red, green and blue.

        If fewer than three wavelengths are known, the first three of `among` are returned, repeated if it has fewer.
        """
        waves = {b: w for b in sorted(among) if (w := self.bands[b].wavelength)}
        if len(waves) < 3:
            return [*among, *among, *among][:3]
        return [min(waves, key=lambda b: abs(waves[b] - w)) for w in (660, 555, 480)]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of bands, rows and columns."""
        return len(self.bands), self.height, self.width

    @property
    def names(self) -> tuple[str, ...]:
        """Band names in file order."""
        return tuple(b.name for b in self.bands)

    def read(self, window: Window | None = None, bands: Sequence[int | str] | None = None) -> FloatArray:
        """Read a window as physical values.

        Parameters
        ----------
        window : ((row0, row1), (col0, col1)), optional
            Half-open ranges inside the scene; the whole scene by default.
        bands : sequence of int or str, optional
            0-based indexes or names; all bands by default.

        Returns
        -------
        (band, row, column) ndarray
            float32, or float64 where the file's own type needs it; NaN where a pixel is not valid.

        Raises
        ------
        InputError, ReadError
            If a band (BandError) or part of the window is not in the scene, or if the file cannot be read.
        """
        (top, bottom), (left, right) = window or ((0, self.height), (0, self.width))
        indexes = range(len(self.bands)) if bands is None else [self.index(b) for b in bands]
        return self.source.read(((top, bottom), (left, right)), list(indexes))

    def index(self, band: int | str) -> int:
        """0-based index of a band given by 0-based index or by name (any case). Raises BandError if there is none."""
        names = [name.casefold() for name in self.names]
        if isinstance(band, str):
            if (wanted := band.strip().casefold()) in names:
                return names.index(wanted)
        elif isinstance(band, Integral) and 0 <= band < len(self.bands):
            return int(band)
        raise BandError(f"no band {band!r} in {self.path or 'the scene'}; it has {self.describe_bands()}")

    def describe_bands(self) -> str:
        """List the bands in one line of text: their numbers (from 1), names and known wavelengths."""
        return ", ".join(
            f"{i} {b.name}" + (f" ({b.wavelength:g} nm)" if b.wavelength else "")
            for i, b in enumerate(self.bands, start=1)
        )
