"""Which band is the near infrared, and what the others are."""

import numpy as np
import pytest

from deglint.errors import BandError
from deglint.readers import band_roles, explain_nir, find_nir, open_scene
from deglint.scene import Band, Scene


def scene_of(*bands):
    return Scene(bands=tuple(bands), height=4, width=5, source=None, path="scene.tif")


def bands_at(*wavelengths):
    return scene_of(*(Band(f"w{w:g}", wavelength=w) for w in wavelengths))


@pytest.mark.parametrize(
    ("at", "index"),
    [
        ((443, 490, 560, 665, 705, 740, 783, 842, 865, 945, 1610), 7),
        ((425, 480, 545, 605, 660, 725, 832.5, 950), 6),
        ((480, 560, 660, 865, 1610), 3),
        ((475, 555, 657.5, 710, 805), 4),
        ((490, 660, 950), 2),
    ],
)
def test_nir_by_wavelength(at, index):
    assert find_nir(bands_at(*at)) == (index,)


@pytest.mark.parametrize("at", [(443, 490, 560, 665, 705, 740), (490, 1240, 1610, 2200), (490,)])
def test_red_edge_and_shortwave_are_no_nir(at):
    with pytest.raises(BandError, match=r"no near-infrared band .* in scene\.tif; it has 1 w4.*--nir") as caught:
        find_nir(bands_at(*at))
    assert "\n" not in str(caught.value)


def test_nir_by_name():
    assert find_nir(scene_of(Band("Blue"), Band("Red Edge"), Band("NIR"))) == (2,)
    assert explain_nir(scene_of(Band("NIR"))) == "NIR is band 1 NIR, by its name"


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ("8,8A", (7, 8)),
        (8, (7,)),
        ("B08", (7,)),
        ("b8a", (8,)),
        ([9, "8"], (8, 7)),
        ("8,8", (7,)),
        ("swir", (11,)),
        ("nir", (7,)),
        ("1", (0,)),
    ],
)
def test_nir_as_asked(wanted, expected):
    codes = [f"B{i:02d}" for i in range(1, 9)] + ["B8A", "B09", "B10", "B11", "B12"]
    at = (443, 490, 560, 665, 705, 740, 783, 842, 865, 945, 1375, 1610, 2190)
    scene = scene_of(*(Band(n, wavelength=w) for n, w in zip(codes, at, strict=True)))
    assert find_nir(scene, wanted) == expected


@pytest.mark.parametrize("wanted", ["0", 0, -1, "-1", 14, "NIR9", "swir", "²", "8A"])
def test_nir_that_is_not_there(wanted):
    with pytest.raises(BandError, match=r"no band .*; allowed are names and numbers 1-2: 1 w490 .*--nir"):
        find_nir(bands_at(490, 842), wanted)


def test_nir_asked_for_nothing():
    with pytest.raises(BandError, match="at least one"):
        find_nir(bands_at(842), " , ")


def test_reason_for_the_log(write, tmp_path):
    scene = bands_at(490, 783, 842, 865)
    assert explain_nir(scene) == "NIR is band 3 w842 (842 nm), nearest to 842 nm of 3 candidates in 750-900 nm"
    path = write(tmp_path / "a.tif", np.zeros((2, 4, 5), np.uint16), names=["x", "y"])
    assert open_scene(path, nir="y").notes == ("NIR is band 2 y, as asked for",)
    with pytest.raises(BandError):
        open_scene(path, nir="z")


def test_roles():
    roles = band_roles(bands_at(441.5, 490, 531, 565, 610, 665, 705, 865, 1375, 2200))
    assert roles == {"blue": 1, "green": 3, "red": 5, "nir": 7, "swir": 9}
    named = band_roles(scene_of(Band("a"), Band("Green")))
    assert named == {"blue": None, "green": 1, "red": None, "nir": None, "swir": None}
