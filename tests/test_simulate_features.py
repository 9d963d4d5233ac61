"""What real scenes have, each with its truth: bottoms, coasts, foam, boats, and errors of the sensor."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.errors import InputError
from deglint.physics import fresnel
from deglint.physics.iops import case1
from deglint.physics.presets import preset
from deglint.physics.sensor import SensorBand
from deglint.simulate import Artefacts, Bottom, FloatingTarget, Setup, simulate, simulate_together, square, whitecaps
from deglint.simulate.cover import Cover
from deglint.simulate.materials import SPECTRA, WAVELENGTHS, reflectance
from deglint.simulate.scene import Light
from deglint.simulate.setup import experiments
from deglint.simulate.underwater import smooth_noise

from .common import says

THESIS = preset("thesis")
STILL = THESIS.delayed(0.0)
SEA = Setup(sensor=STILL, size=(64, 96), wind=3.0, seed=4)
NARROW = replace(STILL, bands=(SensorBand(name="green", low=549.6, high=550.2, full_scale=0.2),))


def test_the_default_sky_has_no_glow_that_waves_would_mirror():
    """Else the truth holds mirrored sky that looks like sun glint."""

    def structure(setup):
        scene = simulate(setup)
        return ((scene.truth - scene.truth_water).std(axis=(1, 2)) / scene.truth.mean(axis=(1, 2))).max()

    assert structure(replace(SEA, wind=5.0, size=(96, 96))) < 0.025
    assert structure(replace(SEA, wind=5.0, size=(96, 96), sky="harrison-coombes")) > 0.2


@pytest.mark.parametrize("objects", [(), (square(8.0, 8.0, 4.0, reflectance=0.2),)])
def test_the_two_truths_differ_by_the_mirrored_sky(objects):
    scene = simulate(replace(SEA, objects=objects))
    mirrored = scene.truth - scene.truth_water
    share = mirrored / scene.light.diffuse[:, None, None]
    assert 0.005 < share.min() < share.max() < 0.05
    np.testing.assert_allclose(share[1], share[0], rtol=0.02, atol=2e-5)  # the same sky, other optics
    away = scene.truth_water[:, :, 64:]
    np.testing.assert_allclose(away, np.broadcast_to(scene.light.water[:, None, None], away.shape), rtol=3e-3)
    assert (scene.truth_water[1][28:36, 28:36].mean() > 1.2 * scene.light.water[1]) == bool(objects)


# Sensor and processing: the truth is not theirs


@pytest.mark.parametrize(
    "artefacts",
    [Artefacts(striping=0.02), Artefacts(resampling="bilinear"), Artefacts(resampling="cubic"),
     Artefacts(resampling="lanczos"), Artefacts(jpeg=80.0), Artefacts(striping=0.05, resampling="cubic", jpeg=50)],
)  # fmt: skip
def test_artefacts_change_the_image_and_leave_the_truth(artefacts):
    plain, other = simulate_together([SEA, replace(SEA, artefacts=artefacts)])
    for name in ("truth", "truth_water", "glint", "glint_mask", "objects"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name), err_msg=name)
    for name in ("image", "truth_image"):
        one, two = getattr(plain, name).astype(float), getattr(other, name).astype(float)
        assert (one != two).mean() > 0.1
        assert two.mean(axis=(1, 2)) == pytest.approx(one.mean(axis=(1, 2)), rel=0.1)  # 8 bits are coarse in the NIR
        assert two.max() <= STILL.levels
    np.testing.assert_array_equal(simulate(other.setup).image, other.image)


def test_stripes_are_gains_of_columns():
    plain, striped = simulate_together([SEA, replace(SEA, artefacts=Artefacts(striping=0.04))])
    ratio = striped.truth_image[:5].mean(axis=1) / plain.truth_image[:5].mean(axis=1)
    assert ratio.std() == pytest.approx(0.04, rel=0.2)
    assert abs(np.corrcoef(ratio[0], ratio[1])[0, 1]) < 0.4  # each band has its own


def test_resampling_keeps_the_place_and_smooths_the_noise():
    scenes = simulate_together([SEA, replace(SEA, artefacts=Artefacts(resampling="bilinear"))])
    middle = np.s_[2, 2:-2, 2:-2]
    expected, (plain, smooth) = (scenes[0].truth + scenes[0].glint)[middle], (s.image[middle] for s in scenes)
    assert np.corrcoef(smooth.ravel(), expected.ravel())[0, 1] > 0.85
    for move in ((0, 1), (1, 0)):
        moved = np.roll(expected, move, (0, 1))
        assert np.corrcoef(smooth.ravel(), moved.ravel())[0, 1] < np.corrcoef(smooth.ravel(), expected.ravel())[0, 1]
    flat = [s.truth_image[middle] - s.truth[middle] / STILL.scale(STILL.bands[2]) for s in scenes]
    assert flat[1].std() == pytest.approx(0.5 * flat[0].std(), rel=0.15)
    assert plain.shape == smooth.shape


# Under water


@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 60.0), st.floats(0.0, 70.0), st.floats(0.03, 2.0))
def test_light_over_a_bottom_falls_off_as_beer_and_lambert_say(angle, sun, chlorophyll):
    """The difference of two grounds falls as exp(-K z) with the path of the sun and that to the sensor."""
    bottom = Bottom(materials=("sand", "algae"))
    setup = replace(SEA, sensor=NARROW, view_zenith=angle, sun_zenith=sun, chlorophyll=chlorophyll, bottom=bottom)
    lit = Light(setup)
    here = case1(550.0, setup.chlorophyll)
    k, u = here.absorption + here.backscattering, here.backscattering / (here.absorption + here.backscattering)
    down, up = (1 / np.cos(np.radians(fresnel.refraction_angle(a))) for a in (setup.sun_zenith, angle))
    near, far = 95, 115  # 12 and 32 m: light that the bottom sends up and the surface back is past
    difference = (lit.bottom[0] - lit.bottom[1])[:, 0]  # of two grounds: the water between them cancels
    fall = np.log(difference[near] / difference[far]) / (lit.depths[far] - lit.depths[near])
    assert fall == pytest.approx(k * (down + 1.04 * np.sqrt(1 + 5.4 * u) * up), rel=0.02)
    assert lit.bottom[:, -1, 0] == pytest.approx(lit.water[0], rel=0.05)  # 60 m are deep, but for the clearest water


def test_noise_larger_than_its_grid_is_noise_of_the_size_of_the_grid():
    """The Gaussian left no wave of the grid: the constant that remained was a rounding error, scaled to thousands."""
    one, other = (smooth_noise((64, 48), 0.25, size, np.random.SeedSequence(1)) for size in (16.0, 1e5))
    np.testing.assert_array_equal(one, other)
    assert (other.mean(), other.std()) == pytest.approx((0.0, 1.0), abs=1e-5)


def test_a_bottom_is_seen_at_its_depth():
    bottom = Bottom(depth=(20.0, 2.0), share=0.0)
    scene = simulate(replace(SEA, bottom=bottom))
    assert scene.depth[:, 0] == pytest.approx(20.0, abs=0.2)
    assert scene.depth[:, -1] == pytest.approx(2.0, abs=0.2)
    level = scene.truth_water[2].mean(axis=0)
    assert (np.diff(level[3:-3]) > 0).all()
    over = np.interp(scene.depth[0, 48], scene.light.depths, scene.light.bottom[0, :, 2])
    assert level[48] == pytest.approx(over, rel=0.01)
    assert level[0] == pytest.approx(level[1], rel=0.05)  # the right edge does not shine over the left one


def test_an_object_below_the_bottom_is_not_seen():
    objects = (square(4.0, 8.0, 4.0, reflectance=0.9, depth=5.0), square(20.0, 8.0, 4.0, reflectance=0.9, depth=9.0))
    bottom = Bottom(depth=(20.0, 2.0), share=0.0)
    scene, bare = (simulate(replace(SEA, bottom=bottom, objects=o)) for o in (objects, ()))
    assert set(np.unique(scene.objects)) == {0, 1}
    np.testing.assert_allclose(scene.truth[:, :, 60:], bare.truth[:, :, 60:], rtol=1e-3)


def test_patches_cover_their_share_and_a_reef_edge_lies_where_it_is_put():
    bottom = Bottom(depth=(20.0, 3.0), edge=(12.0, 2.0), share=0.3, patch=2.0)
    scene = simulate(replace(SEA, bottom=bottom, size=(128, 128)))
    assert np.median(scene.depth[:, :32]) > 19
    assert np.median(scene.depth[:, 72:]) < 4
    ground, patch = (np.interp(scene.depth, scene.light.depths, t) for t in scene.light.bottom[:, :, 2])
    dark = scene.truth_water[2] < 0.5 * (ground + patch)
    assert dark[:, 72:].mean() == pytest.approx(0.3, abs=0.12)


# On the water


def test_a_boat_moves_by_its_speed_times_the_delay():
    sensor = replace(STILL, bands=(STILL.bands[1],) * 2).delayed(0.5)
    boat = FloatingTarget(right=10.0, down=8.0, length=4.0, width=2.0, speed=6.0, heading=120.0)
    scene = simulate(replace(SEA, sensor=sensor, targets=(boat,), size=(80, 96)))
    middles = []
    for band in range(2):
        hull = np.argwhere(scene.cover[band] == 3) * 0.25
        lit = scene.truth_water[band] - scene.light.water[band]
        rows, columns = np.indices(lit.shape)
        middles.append([(lit * rows).sum() / lit.sum() * 0.25, (lit * columns).sum() / lit.sum() * 0.25])
        assert hull.mean(axis=0) == pytest.approx(middles[band], abs=0.2)
    down, right = np.subtract(middles[1], middles[0])
    assert down == pytest.approx(6.0 * 0.5 * np.cos(np.radians(60)), abs=0.1)
    assert right == pytest.approx(6.0 * 0.5 * np.sin(np.radians(60)), abs=0.1)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 8.0), st.floats(-180.0, 360.0), st.floats(0.0, 1.0))
def test_the_outline_of_a_boat_moves_with_speed_heading_and_delay(speed, heading, delay):
    boat = FloatingTarget(right=12.0, down=12.0, length=4.0, width=2.0, speed=speed, heading=heading)
    cover = Cover(replace(SEA, sensor=replace(STILL, bands=STILL.bands[:1]), size=(96, 96), targets=(boat,)))
    start, end = (np.argwhere(cover.at(time)).mean(axis=0) * cover.setup.facet for time in (0.0, delay))
    azimuth = np.radians(heading)
    moved = speed * delay * np.array([-np.cos(azimuth), np.sin(azimuth)])  # down, right
    assert end - start == pytest.approx(moved, abs=0.5 * cover.setup.facet)


def test_what_floats_hides_glint_and_sky_and_has_its_colour():
    boat = FloatingTarget(right=12.0, down=8.0, length=12.0, width=8.0, heading=90.0, material="orange")
    below = square(12.0, 8.0, 2.0, reflectance=0.2)
    scene = simulate(replace(SEA, wind=4.0, targets=(boat,), objects=(below,)))
    inside = np.s_[:, 28:36, 36:52]
    colour = scene.light.matt(["orange"])[0]
    assert scene.glint[inside].max() < 0.02 * scene.glint.max()
    for truth in (scene.truth, scene.truth_water):
        np.testing.assert_allclose(truth[inside].mean(axis=(1, 2)), colour, rtol=0.03)
    assert not scene.objects.any()  # it lies under the boat
    outline = (scene.cover[0] == 3).sum() * 0.25**2
    assert outline == pytest.approx(12 * 8 * (1 - 0.35 / 2), rel=0.02)


def test_foam_and_land_take_their_shares():
    scene = simulate(replace(SEA, size=(128, 128), foam=0.05, coast=8.0))
    share = [(scene.cover[0] == kind).mean() for kind in range(4)]
    assert share[1] == pytest.approx(0.25, abs=0.06)
    assert 0.015 < share[2] < 0.08
    assert share[3] == 0
    assert (scene.cover[0, :, :8] != 1).all()
    assert (scene.cover[0, :, -1] == 1).all()
    assert scene.truth[6][scene.cover[6] == 1].mean() > 5 * scene.truth[6][scene.cover[6] == 0].mean()  # NIR
    assert whitecaps(5.0) < 0.001 < whitecaps(12.0) < 0.03


def test_a_boat_leaves_a_wake_and_may_leave_the_scene():
    gone = FloatingTarget(right=-80.0, down=-80.0, speed=5.0, heading=300.0)
    boat = FloatingTarget(right=18.0, down=8.0, length=5.0, width=2.0, heading=90.0, speed=5.0, wake=8.0)
    cover = simulate(replace(SEA, targets=(gone, boat))).cover[0]
    assert (cover[:, 64:82] == 3).any()
    assert (cover[:, 34:60] == 2).any()  # to the west, behind it
    assert not cover[:, 86:].any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Bottom(depth=(90.0, 3.0)), r"depth .*0.1 to 60 m.* 90"),
        (lambda: Bottom(materials=("sand", "chalk")), "is not one of sand"),
        (lambda: Bottom(edge=(3.0, 0.0)), "width above 0 m"),
        (lambda: FloatingTarget(right=1.0, down=1.0, speed=400.0), r"speed .*0 to 50 m/s"),
        (lambda: Artefacts(jpeg=0), "jpeg must be 1 to 100"),
        (lambda: Artefacts(resampling="sinc"), "is not one of bilinear"),
        (lambda: replace(SEA, coast=100.0), r"coast .*0 to 21.6 m"),
        (lambda: replace(SEA, foam=2.0), r"foam .*0 to 0.5"),
        (lambda: replace(SEA, coast=np.nan), r"coast .*finite number.* nan"),
        (lambda: replace(SEA, sensor=SEA.sensor.delayed(np.nan)), "time offsets .* got nan s"),
        (lambda: replace(SEA, misregistration=((np.nan, 0.0),) * 8), "misregistration must be a finite number"),
        (lambda: FloatingTarget(right=np.nan, down=1.0), r"right .*finite number.* nan"),
        (lambda: simulate_together([SEA, replace(SEA, foam=0.1)]), "differ in foam"),
    ],
)
def test_features_out_of_range_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize("option", [("--boat", "nan,3,5@0"), ("--misregistration", "nan"), ("--delay", "nan")])
def test_numbers_that_are_none_are_an_error_of_use(tmp_path, deglint, option):
    ran = deglint("simulate", tmp_path / "scene", "--size", "32", "--objects", "none", *option)
    assert (ran.code, "own" in ran.err, "nan" in ran.err) == (1, False, True)


def test_spectra_are_reflectances_at_the_wavelengths():
    for name, values in SPECTRA.items():
        assert len(values) == len(WAVELENGTHS)
        assert 0 < min(values) <= max(values) < 1
        assert reflectance(name, 550.0) == values[WAVELENGTHS.index(550)]


def test_features_by_command_are_written_with_their_truth(tmp_path):
    import rasterio

    from deglint.cli import run

    command = "simulate --size 64x96 --wind 3 --objects none --bottom 12:2 --coast 4 --foam auto --boat 8,8,4@45"
    assert (
        run([*command.split(), "--striping", "2", "--resampling", "cubic", "--jpeg", "90", "-q", str(tmp_path / "s")])
        == 0
    )
    setup = json.loads((tmp_path / "s.json").read_text())["setup"]
    assert setup["bottom"]["depth"] == [12.0, 2.0]
    assert setup["foam"] == pytest.approx(whitecaps(3.0))
    assert setup["targets"][0]["heading"] == 45.0
    assert setup["artefacts"] == {"striping": 0.02, "resampling": "cubic", "jpeg": 90}
    with rasterio.open(tmp_path / "s_cover.tif") as cover, rasterio.open(tmp_path / "s_depth.tif") as depth:
        assert set(np.unique(cover.read())) >= {0, 1, 3}
        assert depth.units == ("m",)
    with rasterio.open(tmp_path / "s_truth_water.tif") as low, rasterio.open(tmp_path / "s_truth.tif") as high:
        assert (high.read() - low.read()).mean() > 0
        assert "water alone" in low.tags()["MEANING"]
        assert "mirrored sky, without sun glint" in high.tags()["MEANING"]


def test_a_dry_run_of_a_scene_names_every_file_and_refuses_what_the_run_refuses(tmp_path, deglint):
    import rasterio

    call = ["simulate", "--size", "16x24", "--bottom", "12:2", "--coast", "1", "--surface", "--objects", "none"]
    announced = deglint(*call, tmp_path / "s", "--dry-run", "--json")
    size = deglint(*call, tmp_path / "s.tif", "--dry-run").out
    assert size.startswith(f"{tmp_path / 's.tif'}\n1 scene with the truth, at most ")
    assert list(tmp_path.iterdir()) == []
    files = json.loads(deglint(*call, tmp_path / "s", "--json").out)
    assert sorted(json.loads(announced.out)) == sorted(files) == sorted(map(str, tmp_path.iterdir()))
    total = 0
    for path in (f for f in files if f.endswith(".tif")):
        with rasterio.open(path) as image:
            total += image.read().nbytes
    assert f"at most {total / 1000:.3g} kB." in size
    (tmp_path / "other_objects.tif").touch()
    for dry in ((), ("--dry-run",)):
        ran = deglint(*call, tmp_path / "other", *dry)
        assert (ran.code, "other_objects.tif exists already" in ran.err) == (1, True)
        assert "does not exist" in deglint(*call, tmp_path / "no" / "s", *dry).err
    assert not (tmp_path / "other.tif").exists()


@pytest.mark.slow
def test_a_dry_run_says_what_would_be_written(tmp_path, capsys):
    from deglint.cli import run

    assert run(["simulate", "--grid", "--size", "64", "--wind", "5", "--dry-run", str(tmp_path / "grid")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 31  # three delays, five viewing geometries, two f-numbers
    assert lines[0].endswith("wind05_delay000_view00_000_f10.tif")
    assert says(lines[-1], "30 scenes", "17 MB")
    assert list(tmp_path.iterdir()) == []


def test_delays_of_less_than_a_millisecond_have_names_of_their_own():
    names = [name for name, _ in experiments(Setup(), winds=[9.0], delays=[0.0001, 0.0002])]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("delay", "said"), [(0.0, "000"), (0.06, "060"), (0.0601, "060.1"), (1e-8, "000.00001"), (1.2, "1200")]
)
def test_delays_in_names_have_three_digits_before_the_point(delay, said):
    setup = Setup(sensor=preset("sentinel2"))
    name, _ = next(experiments(setup, winds=[9.0], delays=[delay]))
    assert name == f"wind09_delay{said}_view00_000_f10"


@pytest.mark.parametrize("option", [("--wind", "5", "--wind", "5"), ("--delay", "0.06", "--delay", "0.060")])
def test_scenes_of_one_name_are_refused_before_the_first(tmp_path, deglint, option):
    ran = deglint("simulate", "--grid", "--size", "8", "--objects", "none", *option, tmp_path)
    assert (ran.code, "two outputs have the same name" in ran.err, list(tmp_path.iterdir())) == (1, True, [])


@pytest.mark.parametrize("command", ["simulate", "plan"])
def test_all_options_stand_under_a_heading(command):
    from importlib import import_module

    found = getattr(import_module(f"deglint.cli.{command}"), command)
    assert all(hasattr(p, "heading") for p in found.params if p.param_type_name == "option")


@pytest.mark.parametrize("wrong", [["--boat", "1,2"], ["--bottom", "deep"], ["--foam", "much"], ["--jpeg", "0"]])
def test_features_that_cannot_be_read_are_a_usage_error(tmp_path, wrong):
    from deglint.cli import run

    assert run(["simulate", *wrong, str(tmp_path / "s")]) == 2
