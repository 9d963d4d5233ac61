"""Which band is which: the near infrared that shows glint, and blue, green, red and shortwave infrared.

Bands are told by wavelength, or by name where there is none. Pure: no file is read. A band is never taken
for the near infrared because of its place in the file.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..checks import check_kind
from ..errors import BandError
from ..scene import Scene
from ..sensors import normalise
from .names import nominal_wavelength

Wanted = str | int | Sequence[str | int]

NIR_CENTRE = 842.0
"""[nm] The near infrared that is looked for: broad, beyond the red edge, short of water vapour."""
_NIR_BEST = (750.0, 900.0)
_NIR_LAST = (900.0, 1050.0)
_SWIR = ((1500.0, 1800.0), (2000.0, 2400.0))
_ROLES = {
    "blue": ((450.0, 515.0), 490.0),
    "green": ((520.0, 600.0), 555.0),
    "red": ((620.0, 690.0), 660.0),
}


def find_nir(scene: Scene, wanted: Wanted | None = None) -> tuple[int, ...]:
    """0-based indexes of the near-infrared band(s).

    Parameters
    ----------
    scene : Scene
    wanted : str, int or sequence, optional
        Bands by name or by 1-based number ("8A", 8, "NIR1,NIR2"); "nir" and "swir" ask for the band that
        fits. By default the band inside 750-900 nm nearest to 842 nm, else inside 900-1050 nm; never
        a red edge, and shortwave infrared only when it is asked for.

    Returns
    -------
    tuple of int
        In the order asked for.

    Raises
    ------
    BandError
        None can be deduced, or a band asked for is not there; the message lists the bands.
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    return _choose(scene, wanted)[0]


def explain_nir(scene: Scene, wanted: Wanted | None = None) -> str:
    """One line for the log: which band `find_nir` takes, and why."""
    return _choose(scene, wanted)[1]


def band_roles(scene: Scene) -> dict[str, int | None]:
    """0-based index of the blue, green, red, nir and swir band, or None where there is none.

    Each index stands for one role at most. swir is the band near 1610 nm, else the one near 2200 nm.
    """
    roles: dict[str, int | None] = {role: _nearest(scene, limits, centre) for role, (limits, centre) in _ROLES.items()}
    roles["nir"] = _auto_nir(scene)
    roles["swir"] = _auto_swir(scene)
    return roles


def _choose(scene: Scene, wanted: Wanted | None) -> tuple[tuple[int, ...], str]:
    if wanted is None:
        index = _auto_nir(scene)
        if index is None:
            raise BandError(
                f"no near-infrared band (750-1050 nm) in {scene.path or 'the scene'}; it has "
                f"{scene.describe_bands()}. Name one with --nir NUMBER or --nir NAME."
            )
        return (index,), _reason(scene, index)
    asked = split_wanted(wanted)
    if not asked:
        raise BandError("--nir: want at least one band name or number, got none")
    indexes = tuple(dict.fromkeys(find_band(scene, item) for item in asked))
    said = ", ".join(f"{i + 1} {scene.bands[i].name}" for i in indexes)
    return indexes, f"NIR is band {said}, as asked for"


def split_wanted(wanted: Wanted) -> list[str | int]:
    """The single names and numbers of what a user asks for ("NIR1,NIR2" is two).

    >>> split_wanted("8, 8A"), split_wanted(8), split_wanted([7, "8,9"])
    (['8', '8A'], [8], [7, '8', '9'])
    """
    if isinstance(wanted, int):
        return [wanted]
    if isinstance(wanted, str):
        return [part.strip() for part in wanted.split(",") if part.strip()]
    return [part for item in wanted for part in split_wanted(item)]


def find_band(scene: Scene, wanted: str | int) -> int:
    """0-based index of a band given as users give it: by name, by 1-based number, or as "nir", "swir".

    A name counts before a number; "8A" also finds "B8A" and "b_8a".

    Raises
    ------
    BandError
        No such band; the message lists the bands.
    """
    text = normalise(str(wanted))
    names = [normalise(n) for n in scene.names]
    if isinstance(wanted, str) and text in names:
        return names.index(text)
    if text.isdecimal() and 1 <= int(text) <= len(names) and not str(wanted).strip().startswith("-"):
        return int(text) - 1
    for guess in (f"b{text}", f"b0{text}", f"band{text}"):
        if text and guess in names:
            return names.index(guess)
    role = {"nir": _auto_nir, "swir": _auto_swir}.get(text)
    index = role(scene) if role else None
    if index is not None:
        return index
    raise BandError(
        f"no band {wanted!r} in {scene.path or 'the scene'}; allowed are names and numbers "
        f"1-{len(names)}: {scene.describe_bands()}. Name one with --nir."
    )


def _auto_nir(scene: Scene) -> int | None:
    best = _nearest(scene, _NIR_BEST, NIR_CENTRE)
    return _nearest(scene, _NIR_LAST, NIR_CENTRE) if best is None else best


def _auto_swir(scene: Scene) -> int | None:
    found = [_nearest(scene, limits, centre) for limits, centre in zip(_SWIR, (1610.0, 2200.0), strict=True)]
    return next((i for i in found if i is not None), None)


def _wavelengths(scene: Scene) -> list[float | None]:
    return [b.wavelength if b.wavelength is not None else nominal_wavelength(b.name) for b in scene.bands]


def _nearest(scene: Scene, limits: tuple[float, float], centre: float) -> int | None:
    inside = [
        (abs(w - centre), i) for i, w in enumerate(_wavelengths(scene)) if w is not None and limits[0] <= w <= limits[1]
    ]
    return min(inside)[1] if inside else None


def _reason(scene: Scene, index: int) -> str:
    band = scene.bands[index]
    said = f"NIR is band {index + 1} {band.name}"
    if band.wavelength is None:
        return f"{said}, by its name"
    limits = _NIR_BEST if band.wavelength <= _NIR_BEST[1] else _NIR_LAST
    count = sum(w is not None and limits[0] <= w <= limits[1] for w in _wavelengths(scene))
    return (
        f"{said} ({band.wavelength:g} nm), nearest to {NIR_CENTRE:g} nm of {count} "
        f"candidate{'s' if count > 1 else ''} in {limits[0]:g}-{limits[1]:g} nm"
    )
