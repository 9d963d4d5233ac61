"""Roles of the bands: blue, green, red, near infrared (NIR), which shows glint, and shortwave infrared (SWIR).

The role of a band follows from its wavelength, else from its name, not from its position in the file.
"""

import numbers
from collections.abc import Sequence

from ..checks import check_kind, described, nearest
from ..errors import BandError, InputError
from ..raster.source import ArraySource
from ..scene import Scene
from ..sensors import normalise
from .spectral import band_code, example_names, nominal_wavelength

Wanted = str | int | Sequence[str | int]

NIR_CENTRE = 842.0
"""Preferred wavelength of the near infrared [nm]: longer than the red edge, shorter than absorption by water vapour."""
RED_EDGE, VISIBLE = 750.0, 700.0
"""Wavelengths [nm]: below the first, plumes and shallow bottoms are visible; below the second, clear water is, too."""
_ROLES = {
    "blue": [((450.0, 515.0), 490.0)],
    "green": [((520.0, 600.0), 555.0)],
    "red": [((620.0, 690.0), 660.0)],
    "nir": [((750.0, 900.0), NIR_CENTRE), ((900.0, 1050.0), NIR_CENTRE)],
    "swir": [((1500.0, 1800.0), 1610.0), ((2000.0, 2400.0), 2200.0)],
}
"""For each role, wavelength ranges in order of preference, each with its preferred wavelength [nm]."""


def find_nir(scene: Scene, wanted: Wanted | None = None) -> tuple[int, ...]:
    """Find the near-infrared band(s) of a scene.

    Parameters
    ----------
    scene : Scene
    wanted : str, int or sequence, optional
        Bands by name or by 1-based number ("8A", 8, "NIR1,NIR2"), or by role ("nir", "swir"; see `band_roles`). By
        default, the band nearest to 842 nm inside 750-900 nm; if there is none, the nearest inside 900-1050 nm. A
        red-edge or shortwave-infrared band is used only if it is selected.

    Returns
    -------
    tuple of int
        0-based indexes of the bands, in the order of `wanted`.

    Raises
    ------
    BandError
        No NIR band was found, `wanted` is empty, or a selected band does not exist or is visible light.
    InputError
        `scene` is not a Scene, or `wanted` has something other than names and numbers.
    """
    check_kind(scene, Scene, "scene", "Open it with deglint.open_scene.")
    return _choose(scene, wanted)[0]


def explain_nir(scene: Scene, wanted: Wanted | None = None) -> str:
    """One line for the log that says which bands `find_nir` selects, and why."""
    return _choose(scene, wanted)[1]


def band_roles(scene: Scene) -> dict[str, int | None]:
    """For each role ("blue", "green", "red", "nir", "swir"), the 0-based index of its band; None if no band has it.

    SWIR is the band nearest to 1610 nm in 1500-1800 nm, else to 2200 nm in 2000-2400 nm. A band has at most one role.
    """
    return {role: _by_role(scene, role) for role in _ROLES}


def _choose(scene: Scene, wanted: Wanted | None) -> tuple[tuple[int, ...], str]:
    """0-based indexes of the near-infrared bands, and a line that says why; `wanted` as in `find_nir`."""
    if wanted is None:
        index = _by_role(scene, "nir")
        if index is None:
            raise BandError(_no_nir(scene))
        band = scene.bands[index]
        why = ", by its name" if band.wavelength is None else f" ({band.wavelength:g} nm), nearest to {NIR_CENTRE:g} nm"
        return (index,), f"NIR is band {index + 1} {band.name}{why}"
    asked = split_wanted(wanted)
    if not asked:
        raise BandError("--nir: want at least one band name or number, got none")
    indexes = tuple(dict.fromkeys(find_band(scene, item) for item in asked))
    said = ", ".join(f"{i + 1} {scene.bands[i].name}" for i in indexes)
    return indexes, f"NIR is band {said}, as selected" + _doubts(scene, indexes)


def _doubts(scene: Scene, indexes: Sequence[int]) -> str:
    """Warnings, as text, about bands that the user selected as NIR. Raises BandError for visible bands."""
    known = _wavelengths(scene)
    for i in indexes:
        if (known[i] or VISIBLE) < VISIBLE:
            fit = [f"{j + 1} {scene.bands[j].name} ({w:g} nm)" for j, w in enumerate(known) if w and w >= VISIBLE]
            raise BandError(
                f"band {i + 1} {scene.bands[i].name} ({known[i]:g} nm) is no near infrared: it shows the water itself, "
                "which would be removed with the glint. "
                + (f"Bands beyond {VISIBLE:g} nm: {', '.join(fit)}." if fit else _no_nir(scene))
            )
    edge = ", ".join(scene.bands[i].name for i in indexes if VISIBLE <= (known[i] or 0) < RED_EDGE)
    unknown = ", ".join(scene.bands[i].name for i in indexes if known[i] is None)
    shown = f"{edge} is red edge (below {RED_EDGE:g} nm), where plumes and shallow ground show, too, and are taken for"
    said = f"; warning: {shown} glint" if edge else ""
    if unknown:
        said += f"; warning: the wavelength of {unknown} is not known, and is taken to be near infrared"
    return said


def _no_nir(scene: Scene) -> str:
    """Error message for a scene without a near-infrared band, with the reason and a remedy."""
    what, known, bands = scene.path or "the scene", _wavelengths(scene), scene.describe_bands()
    alpha = getattr(getattr(scene.source, "info", None), "alpha", None)  # 1-based band of the file
    example = _example_of(scene, hidden=alpha is not None)
    alone = len(known) == 1 and not alpha
    if alone or all(w is not None and w < VISIBLE for w in known):
        hidden = f' If band {alpha}, taken for alpha, is its NIR, give --bands "{example}".' if alpha else ""
        few = "one band" if alone else f"no band beyond {VISIBLE:g} nm"
        return (
            f"no near-infrared band in {what}: it has {few} ({bands}), so that no method that follows the near "
            "infrared can remove its glint. What can be done: stack a NIR band of the same image with it (deglint "
            "remove IN NIR.tif OUT), find targets in it as it is (rxdetect score IN OUT), or plan the next flight "
            f"around glint (deglint plan).{hidden}"
        )
    remedy = f"Name another band beyond {VISIBLE:g} nm as NIR (--nir NUMBER), or stack a NIR band of the same image"
    if None in known and isinstance(scene.source, ArraySource):
        remedy = "Name its bands in the attribute long_name, or give a coordinate wavelength [nm]"
    elif None in known:
        remedy = (
            f'Name the bands in their order, such as --bands "{example}", or give --wavelengths (the centres of all '
            f"{len(known)} bands in nm) or --sensor NAME"
        )
    return f"no near-infrared band (750-1050 nm) is known in {what}; it has {bands}. {remedy}."


def _example_of(scene: Scene, *, hidden: bool) -> str:
    """Example of names for --bands, in which "nir" is the alpha band if `hidden`, else a band of unknown wavelength."""
    known = _wavelengths(scene)
    if not any(known):
        return example_names(len(known) + hidden)
    names = [b.name if w else f"b{i}" for i, (b, w) in enumerate(zip(scene.bands, known, strict=True), start=1)]
    if hidden:
        names.append("nir")
    elif None in known:
        names[known.index(None)] = "nir"
    return ",".join(names)


def split_wanted(wanted: Wanted) -> list[str | int]:
    """Split a selection of bands into names and numbers. Raises InputError if it has anything else.

    >>> split_wanted("8, 8A"), split_wanted(8), split_wanted([7, "8,9"])
    (['8', '8A'], [8], [7, '8', '9'])
    """
    if isinstance(wanted, numbers.Integral) and not isinstance(wanted, bool):
        return [int(wanted)]
    if isinstance(wanted, str):
        return [part.strip() for part in wanted.split(",") if part.strip()]
    if isinstance(wanted, (list, tuple)):
        return [part for item in wanted for part in split_wanted(item)]
    raise InputError(f"want a band by name or by number (from 1), or a list of them, got {described(wanted)}.")


def find_band(scene: Scene, wanted: str | int) -> int:
    """0-based index of a band selected by name, by 1-based number, or as "nir", "swir", "red", ...

    A name takes precedence over a number. "8A" also selects "B8A"; "B2" also "SR_B02". Raises BandError if not found.
    """
    (item,) = split_wanted(wanted) if not isinstance(wanted, str) else (wanted,)
    text = normalise(str(item))
    names = [normalise(n) for n in scene.names]
    if isinstance(item, str) and text in names:
        return names.index(text)
    negative = str(item).strip().startswith("-")
    if text.isdecimal() and 1 <= int(text) <= len(names) and not negative:
        return int(text) - 1
    code, codes = band_code(str(item)) or band_code(f"b{text}"), [band_code(n) for n in scene.names]
    if code is not None and codes.count(code) == 1 and not negative:
        return codes.index(code)
    if (index := _by_role(scene, text)) is not None:
        return index
    hint = nearest(text, [*scene.names, *_ROLES])
    raise BandError(
        f"no band {item!r} in {scene.path or 'the scene'}{hint or '.'} Allowed are names and numbers "
        f"1-{len(names)}: {scene.describe_bands()}."
    )


def _by_role(scene: Scene, role: str) -> int | None:
    """0-based index of the band with a role (a key of `_ROLES`), or None.

    It is the band nearest to the preferred wavelength, in the first range of the role that contains a band. Nominal
    wavelengths from names are used only if no stated one is in a range, as a name may mislead ("depth Green").
    """
    for waves in ([b.wavelength for b in scene.bands], _wavelengths(scene)):
        for (low, high), centre in _ROLES.get(role, ()):
            if inside := [(abs(w - centre), i) for i, w in enumerate(waves) if w is not None and low <= w <= high]:
                return min(inside)[1]
    return None


def _wavelengths(scene: Scene) -> list[float | None]:
    return [b.wavelength if b.wavelength is not None else nominal_wavelength(b.name) for b in scene.bands]
