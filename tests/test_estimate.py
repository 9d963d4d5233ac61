"""The f-number from the image: known optics, claimed errors against real ones, and the cases that cannot be told."""

from pathlib import Path

import numpy as np
import pytest

from deglint.compensate.estimate import CELL, Spectra, _Falloff, _grid, estimate_optics, glint_spectra
from deglint.errors import InputError
from deglint.physics.imaging import observe, transform
from deglint.physics.presets import preset

SCENES = Path(__file__).parents[2] / "shared" / "data" / "simulated"
BANDS = (480.0, 660.0, 832.5)


def sea(seed, optics="thesis", *, side=192, noise=0.2, wavelengths=BANDS, strength=1.0):
    """Points of sparkle on a grid of quarter pixels, drawn anew for every band, through the optics, with noise."""
    rng = np.random.default_rng(seed)
    bands = []
    for wavelength in wavelengths:
        spectrum = transform(rng.gamma(0.02, 1.0, (4 * side, 4 * side)))
        bands.append(strength * observe(spectrum, preset(optics), wavelength, factor=4))
    image = np.stack(bands)
    return image + noise * image[0].std() / max(strength, 1e-9) * rng.normal(size=image.shape)


@pytest.mark.parametrize(("optics", "f_number"), [("thesis", 10.0), ("thesis-f30", 30.0)])
def test_known_optics(optics, f_number):
    found = estimate_optics(glint_spectra(sea(0, optics)), BANDS, pitch=8e-6)
    assert found.f_number == pytest.approx(f_number, rel=0.1)
    assert abs(found.f_number - f_number) < 3.5 * found.error
    assert abs(found.exponent) < 3.5 * found.exponent_error  # points have a flat spectrum
    assert found.cells == 36
    assert found.reason.startswith(f"f/{found.f_number:.3g}")


def test_standard_error_is_the_spread_between_seeds():
    found = [estimate_optics(glint_spectra(sea(s, side=224)), BANDS, pitch=8e-6) for s in range(20)]
    real = np.std([f.f_number for f in found], ddof=1)
    claimed = np.sqrt(np.mean([f.error**2 for f in found]))
    assert 0.65 < claimed / real < 1.5  # the spread of 20 is known to 16 % itself
    assert np.mean([f.f_number for f in found]) == pytest.approx(10.0, abs=3.5 * real / np.sqrt(20) + 0.1)


def test_expected_spectrum_is_the_mean_of_many():
    """The model with the true numbers, against the mean periodogram of seas drawn from it."""
    power = np.concatenate([glint_spectra(sea(s, noise=0.0, wavelengths=(660.0,), side=256)).power for s in range(6)])
    used = _grid()[2]
    mean = power[:, :, used].mean(axis=0)
    model = _Falloff(mean, np.array([660.0]), 0.5)
    expected = model.shapes(np.array([np.log(660e-9 * 10 / 8e-6), 0.0]))
    ratio = mean[0] / (expected[0] / expected[0].mean())
    error = power[:, 0][:, used].std(axis=0) / np.sqrt(len(power)) / mean[0]
    assert abs((ratio - ratio.mean()) / (ratio * error)).mean() < 1.2  # .8 for a Gaussian scatter
    assert np.corrcoef(ratio, np.hypot(*(g[used] for g in _grid()[:2])))[0, 1] ** 2 < 0.05


def test_what_has_no_glint_cannot_be_told():
    rng = np.random.default_rng(0)
    for image in (rng.normal(size=(3, 128, 128)), sea(0, strength=0.05)):
        found = estimate_optics(glint_spectra(image), BANDS, pitch=8e-6)
        assert found.f_number is None
        assert np.isnan(found.error)
        assert found.reason.startswith("cannot be told: ")


def test_too_little_of_the_image():
    few = glint_spectra(sea(0, side=64))
    assert len(few.power) == 4
    assert "4 squares" in estimate_optics(few, BANDS, pitch=8e-6).reason
    for image in (np.ones((3, 1, 1)), np.ones((3, 200, 200)), np.full((3, 64, 64), np.nan)):
        found = estimate_optics(glint_spectra(image), BANDS, pitch=8e-6)
        assert found.f_number is None
        assert "0 squares" in found.reason


def test_tiles_merge_and_holes_are_left_out():
    image = sea(1, side=128).astype(np.float32)
    image[1, 40, 70] = np.nan
    before = image.copy()
    whole = glint_spectra(image)
    np.testing.assert_array_equal(image, before)
    assert len(whole.power) == (128 // CELL) ** 2 - 1
    parts = [glint_spectra(image[:, r : r + 64]) for r in (0, 64)]
    np.testing.assert_array_equal(Spectra.merge(parts).power, whole.power)
    with pytest.raises(InputError, match="same bands"):
        Spectra.merge([whole, glint_spectra(image[:2])])
    with pytest.raises(InputError, match="at least one"):
        Spectra.merge([])


def test_scale_and_offset_do_not_matter():
    image = sea(2, side=128)
    found, other = (estimate_optics(glint_spectra(x), BANDS, pitch=8e-6) for x in (image, 1e3 * image + 1e6))
    assert other.f_number == pytest.approx(found.f_number, rel=1e-3)


def test_pitch_scales_the_f_number():
    spectra = glint_spectra(sea(2, side=128))
    one, two = (estimate_optics(spectra, BANDS, pitch=p) for p in (8e-6, 16e-6))
    assert two.f_number == pytest.approx(2 * one.f_number, rel=1e-9)
    assert two.numbers()["f_number"] == two.f_number


def test_refusals_are_one_clear_line():
    with pytest.raises(InputError, match="2 wavelengths are given for 3 bands"):
        estimate_optics(glint_spectra(sea(0, side=64)), BANDS[:2], pitch=8e-6)
    for wavelengths, pitch in ((BANDS, 0.0), ((480.0, np.nan, 832.5), 8e-6), ((0.48, 0.66, 0.83), 8e-6)):
        with pytest.raises(InputError, match="wavelengths must be 100 to 20000 nm"):
            estimate_optics(glint_spectra(sea(0, side=64)), wavelengths, pitch=pitch)
    with pytest.raises(InputError, match=r"\(band, row, column\)"):
        glint_spectra(np.ones((4, 4)))


@pytest.mark.shared
@pytest.mark.skipif(not SCENES.exists(), reason="the shared scenes do not lie beside the project")
@pytest.mark.parametrize(
    ("name", "f_number"),
    [("wind05_delay60", 10), ("wind09_delay00", 10), ("wind12_delay60_sun30", 10), ("wind09_delay60_f30", 30)],
)
def test_shared_scenes(name, f_number):
    """Simulated by another program."""
    from deglint import open_scene

    scene = open_scene(SCENES / f"{name}.tif")
    wavelengths = [b.wavelength for b in scene.bands]
    found = estimate_optics(glint_spectra(scene.read()), wavelengths, pitch=8e-6)
    assert found.f_number == pytest.approx(f_number, rel=0.1)
