"""Which band is the near infrared, and what the others are."""

from pathlib import Path

import numpy as np
import pytest

from deglint.errors import BandError, InputError
from deglint.readers import band_roles, explain_nir, find_nir, open_scene
from deglint.readers.roles import find_band
from deglint.scene import Band

from .common import says, scene_of


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


@pytest.mark.parametrize(("at", "says"), [
    ((443, 490, 560, 665, 705, 740), r"--nir NUMBER"),
    ((490, 1240, 1610, 2200), r"--nir NUMBER"),
    ((490, 660), r".*follows the near infrared.*rxdetect score.*deglint plan"),
])  # fmt: skip
def test_red_edge_and_shortwave_are_no_nir(at, says):
    with pytest.raises(BandError, match=r"no near-infrared.*scene\.tif.*1 w4.*" + says) as caught:
        find_nir(bands_at(*at))
    assert "\n" not in str(caught.value)


def test_nir_by_name():
    assert find_nir(scene_of(Band("Blue"), Band("Red Edge"), Band("NIR"))) == (2,)
    assert says(explain_nir(scene_of(Band("NIR"))), "band 1 NIR", "by its name")


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
        ("6", (5,)),
        ("B6", (5,)),
    ],
)
def test_nir_as_asked(wanted, expected):
    codes = [f"B{i:02d}" for i in range(1, 9)] + ["B8A", "B09", "B10", "B11", "B12"]
    at = (443, 490, 560, 665, 705, 740, 783, 842, 865, 945, 1375, 1610, 2190)
    scene = scene_of(*(Band(n, wavelength=w) for n, w in zip(codes, at, strict=True)))
    assert find_nir(scene, wanted) == expected


@pytest.mark.parametrize("wanted", ["0", 0, -1, "-1", 14, "NIR9", "swir", "²", "8A"])
def test_nir_that_is_not_there(wanted):
    with pytest.raises(BandError, match=r"no band .*numbers 1-2: 1 w490 "):
        find_nir(bands_at(490, 842), wanted)


def test_a_visible_band_is_refused_as_nir_and_a_red_edge_is_warned_of():
    scene = bands_at(490, 660, 720, 842)
    with pytest.raises(BandError, match=r"2 w660.*no near infrared.*3 w720.*4 w842"):
        find_nir(scene, "4,2")
    assert "warning: w720 is red edge" in explain_nir(scene, 3)
    assert "warning" not in explain_nir(scene, 4)
    with pytest.raises(BandError, match="no band beyond 700 nm"):
        find_nir(scene_of(Band("red"), Band("green")), "red")


@pytest.mark.parametrize("wanted", [8.0, True, None, {"nir"}, Path("nir"), np.array([4]), [1, None], b"nir"])
def test_what_is_no_band_at_all_is_named_in_one_line(wanted):
    wanted = {"wanted": wanted} if wanted is None else wanted
    with pytest.raises(InputError, match=r"by name or by number.*list of them") as caught:
        find_nir(bands_at(490, 842), wanted)
    assert "\n" not in str(caught.value)


def test_a_misspelt_band_is_told_the_nearest():
    scene = scene_of(Band("blue"), Band("green"), Band("nir"))
    with pytest.raises(BandError, match=r"no band 'Bleu'.*scene\.tif.*mean 'blue'\? [A-Z]") as caught:
        find_band(scene, "Bleu")
    assert "--nir" not in str(caught.value)
    assert find_band(scene_of(Band("SR_B2"), Band("SR_B3")), "B02") == 0
    for wanted in (-8, "-8"):
        with pytest.raises(BandError, match=r"no band '?-8'? in"):
            find_band(scene_of(Band("B3"), Band("B8")), wanted)
    assert find_band(bands_at(490, 660), "red") == 1


def test_nir_asked_for_nothing():
    with pytest.raises(BandError, match="at least one"):
        find_nir(bands_at(842), " , ")


def test_reason_for_the_log(write, tmp_path):
    scene = bands_at(490, 783, 842, 865)
    assert says(explain_nir(scene), "band 3 w842", "nearest to 842 nm")
    path = write(tmp_path / "a.tif", np.zeros((2, 4, 5), np.uint16), names=["x", "y"])
    (note,) = open_scene(path, nir="y").notes
    assert says(note, "band 2 y", "warning", "wavelength of y is not known")
    with pytest.raises(BandError, match="no band 'z'"):
        open_scene(path, nir="z")


def test_roles_follow_wavelengths_or_names():
    roles = band_roles(bands_at(441.5, 490, 531, 565, 610, 665, 705, 865, 1375, 2200))
    assert roles == {"blue": 1, "green": 3, "red": 5, "nir": 7, "swir": 9}
    named = band_roles(scene_of(Band("a"), Band("Green")))
    assert named == {"blue": None, "green": 1, "red": None, "nir": None, "swir": None}


def test_a_product_beside_bands_has_no_role():
    known = [Band("B2", wavelength=490.0), Band("B3", wavelength=560.0), Band("B4", wavelength=665.0)]
    roles = band_roles(scene_of(*known, Band("depth Green"), Band("NIR")))
    assert roles == {"blue": 0, "green": 1, "red": 2, "nir": 4, "swir": None}
