"""Spectral and angular tables of published models, as CSV files; the header of each gives its source and licence."""

from functools import cache
from importlib import resources

import numpy as np
import numpy.typing as npt

from .._checks import Array, within

WAVELENGTH_RANGE = (300.0, 1000.0)  # wavelength range of the tables of light and water [nm]


def checked_wavelength(wavelength: npt.ArrayLike) -> Array:
    """Return wavelengths [nm] as float64; raise InputError if one of them is outside `WAVELENGTH_RANGE`."""
    return within("wavelength", wavelength, *WAVELENGTH_RANGE, "nm", "Give it in nanometres.")


def interpolate(table: str, column: str, wavelength: npt.ArrayLike) -> Array:
    """Interpolate the column `column` of the table `table` (see `load`) linearly to wavelengths [nm]."""
    columns = load(table)
    return np.asarray(np.interp(checked_wavelength(wavelength), columns["wavelength_nm"], columns[column]))


@cache
def load(name: str) -> dict[str, npt.NDArray[np.float64]]:
    """Columns of a table of this package, by column name; `name` is the name of the table's file without ``.csv``.

    Examples
    --------
    >>> load("sea_water")["wavelength_nm"][:2].tolist()
    [250.0, 260.0]
    """
    text = resources.files(__name__).joinpath(f"{name}.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    values = np.array([line.split(",") for line in lines[1:]], dtype=np.float64)
    return dict(zip(lines[0].split(","), values.T, strict=True))
