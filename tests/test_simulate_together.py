"""What several sensors see of one sea is, to the bit, what each would see alone."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deglint.errors import InputError
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, simulate_together, thesis_array

THESIS = preset("thesis")
SEA = Setup(size=(48, 40), wind=3.0, sky="cardioidal", seed=5)
SENSORS = (
    THESIS.delayed(0.0),
    THESIS.delayed(0.01),
    replace(THESIS.delayed(0.02), f_number=30.0),  # some of its times are those of the one before
    replace(THESIS, smear=3.0, read_noise=90.0, bits=11),
)
ARRAYS = ("image", "truth", "truth_image", "glint", "glint_mask", "objects", "height", "slopes")


@pytest.mark.slow
@pytest.mark.parametrize("objects", [(), thesis_array(SEA.size, 0.25, sides=[4])])
def test_together_is_one_by_one(objects):
    setups = [replace(SEA, sensor=s, objects=objects) for s in SENSORS]
    setups[1] = replace(setups[1], misregistration=((0.25, -0.5),) * 8, glint_threshold=0.1)
    calls = []
    together = simulate_together(setups, workers=2, keep_surface=True, progress=lambda *a: calls.append(a))
    assert calls == [(n, 32) for n in range(1, 33)]
    for setup, one in zip(setups, together, strict=True):
        alone = simulate(setup, keep_surface=True)
        assert one.setup == setup
        assert one.resolved_slope_variance == alone.resolved_slope_variance
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(one, name), getattr(alone, name), err_msg=name)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (replace(SEA, wind=4.0, seed=6), "setups 1 and 2 differ in wind, seed;"),
        (replace(SEA, sensor=replace(THESIS, bands=THESIS.bands[:5])), "differ in bands of the sensor"),
        (replace(SEA, sensor=replace(THESIS, gsd=0.3)), "differ in gsd of the sensor"),
    ],
)
def test_two_seas_are_refused(other, words):
    with pytest.raises(InputError, match=words):
        simulate_together([SEA, other])


def test_the_image_alone_is_written_on_request(tmp_path):
    import rasterio

    scene = simulate(SEA)
    files = write_scene(scene, tmp_path / "sea", truth=False)
    assert [p.name for p in files] == ["sea.tif", "sea.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sea.json", "sea.tif"]
    assert list(json.loads(files[1].read_text())["files"].values()) == ["sea.tif"]
    with rasterio.open(files[0]) as image:
        np.testing.assert_array_equal(image.read(), scene.image)
