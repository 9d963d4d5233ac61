"""One worked case through every room: a grey object at 10 m, five bands, four looks."""

import numpy as np
import pytest

from deglint.physics import atmosphere, glint, sky, water
from deglint.physics.iops import case1

from ..common import TABLES

PAPER = TABLES / "gregg_carder_1990_hydrolight_350_801.csv"
BANDS = [(400, 450), (450, 510), (510, 580), (585, 625), (630, 690)]
AIR = atmosphere.Air(air_mass_type=1, humidity=80, water_vapour=2.5, wind_mean=9, wind=9, visibility=40, ozone=300)
SUN = (20.5, 270.2)
LOOKS = {"nadir": (0.0, 0.0), "aside": (40.0, 0.2), "sunward": (40.0, 270.2), "mirror": (20.5, 90.2)}
EXPECTED = {
    "nadir": {
        "background": (0.00728, 0.00664, 0.00330, 0.00076, 0.00034),
        "object": (0.01661, 0.01943, 0.01189, 0.00130, 0.00036),
        "weber": (1.282, 1.924, 2.599, 0.721, 0.050),
        "sky": (0.00205, 0.00189, 0.00148, 0.00122, 0.00104),
        "glint": (0.01830, 0.02316, 0.02296, 0.02177, 0.02013),
    },
    "aside": {
        "background": (0.00740, 0.00680, 0.00341, 0.00078, 0.00035),
        "object": (0.01585, 0.01848, 0.01106, 0.00121, 0.00037),
        "weber": (1.144, 1.717, 2.247, 0.540, 0.029),
        "sky": (0.00263, 0.00243, 0.00190, 0.00156, 0.00133),
        "glint": (0.00164, 0.00207, 0.00206, 0.00195, 0.00180),
    },
    "sunward": {"background": (0.00780, 0.00714, 0.00356, 0.00082, 0.00037)},
    "mirror": {"glint": (0.0487, 0.0616, 0.0611, 0.0579, 0.0536)},
}


def paper(wavelength):
    if not PAPER.exists():
        pytest.skip(f"{PAPER.name} does not lie beside the project")
    rows = np.loadtxt(PAPER, delimiter=",", skiprows=2).T
    return atmosphere.Spectrum(*(np.interp(wavelength, rows[0], column) for column in rows[1:]))


def parts(look, band, spectrum=None):
    wavelength = np.arange(band[0], band[1] + 1.0)
    light = atmosphere.irradiance(wavelength, SUN[0], AIR, spectrum=spectrum and spectrum(wavelength))
    total = light.direct + light.diffuse
    view = LOOKS[look]
    sea, angles = case1(wavelength, 0.5), (SUN[0], view[0])
    alone = water.deep_reflectance(sea, *angles, view[1] - SUN[1])
    deep = np.mean(alone * total)
    options = {"depth": 10.0, "reflectance": 0.15, "direct_fraction": light.direct / total}
    bright = np.mean(water.submerged_reflectance(sea, alone, *angles, **options) * total)
    spark = glint.sun_glint(*SUN, *view, wind=9.0, wind_from=0.0).radiance
    mirrored = sky.reflectance(*view, *SUN, wind=9.0, wind_from=0.0)
    return {
        "background": deep,
        "object": bright,
        "weber": bright / deep - 1,
        "sky": mirrored * light.diffuse.mean(),
        "glint": spark * light.direct.mean() / np.cos(np.radians(SUN[0])),
        "direct": light.direct.mean(),
        "diffuse": light.diffuse.mean(),
    }


@pytest.mark.shared
@pytest.mark.parametrize(("look", "name"), [(look, name) for look in EXPECTED for name in EXPECTED[look]])
def test_radiances_to_two_per_cent(look, name):
    found = [parts(look, band, paper)[name] for band in BANDS]
    printed = 5e-4 if name == "weber" else 5e-5 if look == "mirror" else 5e-6
    for value, wanted in zip(found, EXPECTED[look][name], strict=True):
        assert value == pytest.approx(wanted, rel=0.02, abs=printed)


@pytest.mark.shared
def test_irradiances_to_four_digits():
    found = [parts("nadir", band, paper) for band in BANDS]
    direct, diffuse = ([part[name] for part in found] for name in ("direct", "diffuse"))
    assert direct == pytest.approx([1.0910, 1.3806, 1.3688, 1.2978, 1.1999], abs=6e-5)
    assert diffuse == pytest.approx([0.3037, 0.2806, 0.2191, 0.1803, 0.1536], abs=6e-5)


@pytest.mark.parametrize("look", ["nadir", "aside"])
def test_contrast_with_the_table_of_this_package(look):
    for band, wanted in zip(BANDS, EXPECTED[look]["weber"], strict=True):
        assert parts(look, band)["weber"] == pytest.approx(wanted, rel=0.02, abs=5e-4)


def test_sunward_there_is_hardly_any_glint():
    glints = [parts("sunward", band)["glint"] for band in BANDS]
    assert min(glints) > 7e-5
    assert max(glints) < 1.1e-4


def test_aside_glint_is_as_improbable_as_published():
    found = glint.sun_glint(*SUN, *LOOKS["aside"], wind=9.0, wind_from=0.0).probability
    assert found == pytest.approx(4.5e-6, abs=0.6e-7)
