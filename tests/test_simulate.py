"""Synthetic scenes against closed forms: light, mean glint, what moves, what the truth holds."""

import json
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from scipy.integrate import trapezoid

from deglint.cli.options import ChoiceFromTable
from deglint.errors import InputError, WriteError
from deglint.physics import glint, sky, slopes, waves
from deglint.physics.atmosphere import Air
from deglint.physics.presets import PRESETS, preset
from deglint.physics.spectra import dispersion
from deglint.simulate import Setup, SubmergedObject, simulate, square, thesis_array, whitecaps
from deglint.simulate.artefacts import Kernel
from deglint.simulate.facets import Facets
from deglint.simulate.scene import Light
from deglint.simulate.setup import SlopeModelName, experiments
from deglint.simulate.underwater import label

from .common import says

THESIS = preset("thesis")
STILL = THESIS.delayed(0.0)
SMALL = Setup(sensor=STILL, size=(96, 64), wind=3.0, sun_zenith=20.0, seed=3)


# Light: the end-to-end case of the thesis, worked out independently with another table of the sun, hence 2 %

CASE = {
    "view": (0.0, 0.0),
    "direct": [1.0910, 1.3806, 1.3688, 1.2978, 1.1999],
    "diffuse": [0.3037, 0.2806, 0.2191, 0.1803, 0.1536],
    "water": [0.00728, 0.00664, 0.00330, 0.00076, 0.00034],
    "object": [0.01661, 0.01943, 0.01189, 0.00130, 0.00036],
    "glint": [0.01830, 0.02316, 0.02296, 0.02177, 0.02013],
    "sky": [0.00205, 0.00189, 0.00148, 0.00122, 0.00104],
}
CASES = {
    "nadir": CASE,
    "across the sun": CASE
    | {
        "view": (40.0, 0.2),
        "water": [0.00740, 0.00680, 0.00341, 0.00078, 0.00035],
        "object": [0.01585, 0.01848, 0.01106, 0.00121, 0.00037],
        "glint": [0.00164, 0.00207, 0.00206, 0.00195, 0.00180],
        "sky": [0.00263, 0.00243, 0.00190, 0.00156, 0.00133],
    },
    "specular": CASE
    | {"view": (20.5, 90.2), "water": None, "object": None, "sky": None,
       "glint": [0.0487, 0.0616, 0.0611, 0.0579, 0.0536]},
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_light_of_the_worked_case_in_five_bands(name):
    case = CASES[name]
    setup = Setup(
        sensor=replace(STILL, bands=STILL.bands[:5]),
        wind=9.0,
        wind_from=0.0,
        sun_zenith=20.5,
        sun_azimuth=270.2,
        view_zenith=case["view"][0],
        view_azimuth=case["view"][1],
        air=Air(visibility=40, humidity=80, water_vapour=2.5, ozone=300, wind=9, wind_mean=9),
        sky="uniform",
        objects=(square(20, 20, 4, reflectance=0.15, depth=10),),
    )
    lit = Light(setup)
    view = setup.view_zenith, setup.view_azimuth
    wind = {"wind": 9.0, "wind_from": 0.0}
    bright = glint.sun_glint(20.5, 270.2, *view, **wind).radiance * lit.normal
    # the worked case takes the sky's reflectance across the wind at every azimuth
    mirrored = sky.reflectance(view[0], 90.0, **wind) * lit.diffuse
    got = {"direct": lit.direct, "diffuse": lit.diffuse, "water": lit.water, "object": lit.objects[0]}
    for part, value in (got | {"glint": bright, "sky": mirrored}).items():
        if case[part] is not None:  # printed digits end at 5e-6, or 5e-5
            digit = 5e-5 if part in ("direct", "diffuse") or name == "specular" else 5e-6
            np.testing.assert_allclose(value, case[part], rtol=0.02, atol=digit, err_msg=part)


# The sea


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wind", "zenith", "gsd"),
    [(2.0, 20.0, 0.25), (5.0, 20.0, 0.5), (9.0, 20.0, 1.0), (9.0, 40.0, 1.0), (12.0, 30.0, 1.0)],
)
def test_mean_glint_and_sky_are_those_of_the_closed_forms(wind, zenith, gsd):
    got = []
    for seed in range(6):
        setup = Setup(
            sensor=replace(STILL, gsd=gsd),
            wind=wind,
            size=(192, 192),
            sun_zenith=zenith,
            seed=seed,
            sky="uniform",
        )
        sea = Facets(setup)
        density, mirrored = sea.at(0.0)
        got.append([density.mean(dtype=np.float64) * sea.glint_factor, mirrored.mean(dtype=np.float64) * np.pi])
    at_mast = slopes.wind_at_height(wind)
    closed = glint.sun_glint(zenith, 135.0, 0.0, 0.0, wind=at_mast, wind_from=30.0).radiance
    mirrored = np.pi * sky.reflectance(0.0, 0.0, wind=at_mast, wind_from=30.0)
    mean = np.mean(got, axis=0)
    assert mean[0] == pytest.approx(float(closed), rel=0.03)
    assert mean[1] == pytest.approx(float(mirrored), rel=0.01)


def test_mean_glint_seen_at_an_angle_follows_the_closed_form():
    look = {"sun_zenith": 30.0, "sun_azimuth": 135.0, "view_zenith": 25.0, "view_azimuth": 290.0}
    got = []
    for seed in range(6):
        setup = Setup(sensor=replace(STILL, gsd=1.0), wind=6.0, size=(192, 192), seed=seed, **look)
        sea = Facets(setup)
        got.append(sea.at(0.0)[0].mean(dtype=np.float64) * sea.glint_factor)
    closed = glint.sun_glint(*look.values(), wind=slopes.wind_at_height(6.0), wind_from=30.0).radiance
    assert np.mean(got) == pytest.approx(float(closed), rel=0.03)


@pytest.mark.parametrize(
    ("name", "wind", "spectrum"),
    [("thesis", 2.0, "elfouhaily"), ("thesis", 5.0, "elfouhaily"), ("thesis", 9.0, "jonswap"),
     ("worldview3", 5.0, "elfouhaily"), ("worldview3", 14.0, "elfouhaily"), ("micasense", 2.0, "elfouhaily"),
     ("micasense", 4.0, "jonswap"), ("sentinel2", 14.0, "pierson-moskowitz")],
)  # fmt: skip
def test_resolved_and_unresolved_slopes_add_up_to_those_measured(name, wind, spectrum):
    setup = Setup(sensor=preset(name), wind=wind, spectrum=spectrum, fetch=20e3, size=(16, 16))
    sea = Facets(setup)
    assert max(setup.slope_variance) > min(sea.unresolved) > 0
    parts = sea.slope_variance, sea.sparkle, sea.unresolved, setup.slope_variance
    for resolved, sparkle, about, measured in zip(*parts, strict=True):
        assert resolved <= 0.9501 * measured
        assert resolved + sparkle + about == pytest.approx(measured, rel=1e-9)


def test_sparkle_forgets_as_the_spectrum_says():
    lags = np.array([0.008, 0.016, 0.030, 0.060])
    sensor = replace(STILL, bands=tuple(replace(STILL.bands[0], time_offset=t) for t in (0.0, *lags)))
    setup = Setup(sensor=sensor, size=(64, 64), wind=4.0, patch=0.05)
    sea = Facets(setup)
    amplitudes, choice, frequencies = sea._sparkle
    phase = frequencies[choice][..., None] * np.concatenate([[0.0], lags])
    tilt = amplitudes[..., 0:1] * np.cos(phase) + amplitudes[..., 1:2] * np.sin(phase)
    got = (tilt[..., 1:] * tilt[..., :1]).mean(axis=(0, 1)) / (tilt[..., 0] ** 2).mean()
    k = waves.wavenumbers(setup.sea, longest=2 * setup.facet)
    weight = waves.omnidirectional(k, setup.sea) * k**3
    moved = trapezoid(weight * np.cos(lags[:, None] * dispersion(k)), np.log(k))
    expected = moved / trapezoid(weight, np.log(k))
    np.testing.assert_allclose(got, expected, atol=0.02)
    for t in range(5):
        assert tilt[..., t].var() == pytest.approx(sea.sparkle[0], rel=0.02)


def hits(setup, cone):
    """Which facets mirror a direction within `cone` degrees of the sun straight up, each having one slope."""
    sea = Facets(setup)
    up, cross = slopes.to_wind_axes(*sea.surface.slopes(), setup.wind_from)
    east, north = slopes.from_wind_axes(up + sea._sparkle[0][..., 0], cross + sea._sparkle[0][..., 2], setup.wind_from)
    squared = 1 + east**2 + north**2
    seen = np.stack([-2 * east, -2 * north, 2 - squared]) / squared
    zenith, azimuth = np.radians(setup.sun_zenith), np.radians(setup.sun_azimuth)
    sun = np.array([np.sin(zenith) * np.sin(azimuth), np.sin(zenith) * np.cos(azimuth), np.cos(zenith)])
    return np.tensordot(sun, seen, 1) > np.cos(np.radians(cone))


@pytest.mark.slow
def test_facets_that_hit_the_sun_are_as_many_as_the_avoidance_tool_says():
    cone = 2.0
    setup = Setup(
        sensor=replace(STILL, gsd=0.5), wind=5.0, size=(128, 128), sun_zenith=30.0, patch=1.0,
        slopes="cox-munk-gaussian",
    )  # fmt: skip
    counted = [hits(replace(setup, seed=seed), cone) for seed in range(16)]
    closed = glint.sun_glint(
        30.0, 135.0, 0.0, 0.0, wind=slopes.wind_at_height(5.0), wind_from=30.0, model="cox-munk-gaussian"
    )
    share = glint.probability(closed.density, 0.0, closed.tilt, glint.cone(cone))
    assert np.sum(counted) > 2500
    assert np.mean(counted) == pytest.approx(float(share), rel=0.05)


def test_kernel_agrees_with_plain_numpy():
    setup = replace(SMALL, sensor=THESIS, sky="uniform", patch=0.03)
    sea, time = Facets(setup), 0.06
    got, mirrored = sea.at(time)
    up, cross = slopes.to_wind_axes(*sea.surface.slopes(time), setup.wind_from)
    amplitudes, choice, frequencies = sea._sparkle
    phase = frequencies[choice] * time
    up = up * sea.slope_scale[0] + amplitudes[..., 0] * np.cos(phase) + amplitudes[..., 1] * np.sin(phase)
    cross = cross * sea.slope_scale[1] + amplitudes[..., 2] * np.cos(phase) + amplitudes[..., 3] * np.sin(phase)
    facet = glint.facet(setup.sun_zenith, setup.sun_azimuth, 0.0, 0.0)
    wanted = slopes.to_wind_axes(facet.east, facet.north, setup.wind_from)
    density = slopes.gaussian(up - wanted[0], cross - wanted[1], *sea.unresolved)
    np.testing.assert_allclose(got, density, rtol=2e-3, atol=1e-4 * density.max())
    angle = np.degrees(np.arctan(np.hypot(up, cross)))
    from deglint.physics.fresnel import reflectance

    np.testing.assert_allclose(mirrored, reflectance(angle) / np.pi, rtol=0.01)


# Scenes


@pytest.fixture(scope="module")
def moving():
    return simulate(replace(SMALL, sensor=THESIS, size=(128, 128), wind=4.0, sun_zenith=30.0))


def test_same_setup_same_bits_whatever_the_threads():
    setup = replace(SMALL, sensor=THESIS, objects=(square(8, 8, 3, reflectance=0.1),))
    one, two = simulate(setup, workers=1, keep_surface=True), simulate(setup, workers=3, keep_surface=True)
    for part in ("image", "truth", "truth_image", "glint", "glint_mask", "objects", "height", "slopes"):
        np.testing.assert_array_equal(getattr(one, part), getattr(two, part), err_msg=part)
    other = simulate(replace(setup, seed=4))
    assert not np.array_equal(one.image, other.image)


def test_shapes_types_and_finite_values(moving):
    assert moving.image.shape == moving.truth.shape == moving.glint.shape == (8, 128, 128)
    assert moving.objects.shape == (128, 128)
    assert moving.image.dtype == moving.truth_image.dtype == np.uint16
    assert np.isfinite(moving.truth).all()
    assert np.isfinite(moving.glint).all()
    assert moving.truth.min() > 0
    assert moving.glint.min() >= 0
    assert moving.image.max() <= THESIS.levels


def test_without_delays_all_bands_see_one_sea():
    band = STILL.bands[2]
    sensor = replace(STILL, bands=tuple(replace(band, name=f"B{i}") for i in range(3)))
    scene = simulate(replace(SMALL, sensor=sensor))
    for i in (1, 2):
        np.testing.assert_array_equal(scene.glint[i], scene.glint[0])
        np.testing.assert_array_equal(scene.truth[i], scene.truth[0])
        assert not np.array_equal(scene.image[i], scene.image[0])  # noise is each band's own


def test_with_delays_bands_grow_apart(moving):
    alike = [np.corrcoef(moving.glint[0].ravel(), moving.glint[i].ravel())[0, 1] for i in range(1, 4)]
    assert 0.9 > alike[0] > alike[1] > alike[2]
    still = simulate(replace(moving.setup, sensor=STILL))
    assert np.corrcoef(still.glint[0].ravel(), still.glint[3].ravel())[0, 1] > 0.98  # optics alone differ
    np.testing.assert_allclose(still.glint[0], moving.glint[0], rtol=1e-4, atol=1e-7)  # the first band is the same


def test_without_glint_the_scene_is_its_truth():
    scene = simulate(replace(SMALL, wind=2.0, sun_zenith=75.0, sky="uniform"))
    assert scene.glint.max() < 1e-12
    np.testing.assert_array_equal(scene.image, scene.truth_image)
    assert not scene.glint_mask.any()
    scale = np.array([STILL.scale(b) for b in STILL.bands])[:, None, None]
    assert abs((scene.truth_image * scale - scene.truth).mean(axis=(1, 2)) / scale[:, 0, 0]).max() < 0.5


def test_image_is_truth_and_glint_with_noise(moving):
    for i, band in enumerate(THESIS.bands):
        scale = THESIS.scale(band)
        clear = moving.image[i] < THESIS.levels
        error = (moving.image[i] * scale - moving.truth[i] - moving.glint[i])[clear]
        assert abs(error.mean()) < 0.35 * scale
        assert error.std() < 8 * scale
        np.testing.assert_array_equal(moving.glint_mask[i], moving.glint[i] > 0.25 * moving.truth[i])


def test_truth_holds_water_sky_and_objects_but_no_glint():
    patch = square(8.0, 12.0, 6.0, reflectance=0.2, depth=3.0)
    scene = simulate(replace(SMALL, sky="uniform", objects=(patch,)))
    mirrored = float(sky.reflectance(0.0, 0.0, wind=slopes.wind_at_height(3.0), wind_from=30.0))
    inside = scene.objects == 1
    outside = np.ones_like(inside)
    outside[20:76, 4:60] = False  # well away from the object
    assert inside.sum() == 24 * 24
    assert np.argwhere(inside).min(axis=0).tolist() == [36, 20]
    for i in range(5):
        background = scene.light.water[i] + mirrored * scene.light.diffuse[i]
        assert scene.truth[i][outside].mean() == pytest.approx(background, rel=0.01)
        middle = scene.truth[i][44:52, 28:36].mean()
        over = scene.light.objects[0, i] + mirrored * scene.light.diffuse[i]
        assert middle == pytest.approx(over, rel=0.02)


def test_objects_are_labelled_where_their_corners_say():
    labels = label([square(2.0, 3.0, 2.0, reflectance=0.1)], (20, 16), 0.25)
    rows, columns = np.nonzero(labels)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (8, 15, 4, 11)
    assert labels.sum() == 64
    triangle = SubmergedObject(corners=((0.0, 0.0), (4.0, 0.0), (0.0, 4.0)), reflectance=0.1)
    assert label([triangle], (40, 40), 0.1).sum() == pytest.approx(800, abs=25)


def test_thesis_array_leaves_the_left_half_free():
    objects = thesis_array((256, 256), 0.25)
    assert sorted({o.reflectance for o in objects}) == [0.02, 0.05, 0.10, 0.20]
    assert {o.depth for o in objects} == {5.0}
    labels = label(objects, (256, 256), 0.25)
    assert not labels[:, :128].any()
    areas = [int((labels == n).sum()) for n in range(1, len(objects) + 1)]
    assert sorted(set(areas)) == [4, 16, 64, 256]
    assert len(thesis_array((32, 32), 0.25)) > 0


def test_misregistration_shifts_one_band_only():
    band = STILL.bands[2]
    sensor = replace(STILL, bands=(band, replace(band, name="SHIFTED")))
    setup = replace(SMALL, sensor=sensor, wind=4.0, size=(128, 128), misregistration=((0.0, 0.0), (1.0, 0.0)))
    scene = simulate(setup)
    np.testing.assert_allclose(scene.glint[1][:-1], scene.glint[0][1:], atol=1e-3 * scene.glint.max())


def test_height_and_slopes_are_kept_on_request():
    scene = simulate(replace(SMALL, wind=4.0, size=(128, 128)), keep_surface=True)
    rows = -np.gradient(scene.height, STILL.gsd, axis=0)
    assert np.corrcoef(rows.ravel(), scene.slopes[1].ravel())[0, 1] > 0.95
    columns = np.gradient(scene.height, STILL.gsd, axis=1)
    assert np.corrcoef(columns.ravel(), scene.slopes[0].ravel())[0, 1] > 0.95
    assert simulate(SMALL).height is None


def test_progress_counts_the_bands():
    seen = []
    simulate(replace(SMALL, sensor=THESIS), progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i, 8) for i in range(1, 9)]


@pytest.mark.slow
def test_experiments_are_all_combinations_with_names_of_their_own():
    setups = dict(experiments(Setup()))
    assert len(setups) == 4 * 3 * 5 * 2
    one, two = setups["wind09_delay000_view00_000_f10"], setups["wind09_delay060_view00_000_f30"]
    assert one.seed == two.seed
    assert max(one.times) == 0
    assert max(two.times) == pytest.approx(0.42)
    assert (one.sensor.f_number, two.sensor.f_number) == (10.0, 30.0)
    assert len({s.seed for s in setups.values()}) == 20


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"wind": 30.0}, "wind must be"),
        ({"wind": float("nan")}, "wind ... finite number ... nan"),
        ({"wind": 19.7, "sensor": preset("sentinel2")}, "wind ... 1 to 19.6 m/s ... 19.7"),
        ({"seed": -1}, "seed must be 0 to"),
        ({"seed": 0.5}, "seed ... integer ... 0.5"),
        ({"size": (64.5, 64)}, "size ... integer ... 64.5"),
        ({"size": (64,)}, "size ... 2 numbers ... (64,)"),
        ({"size": 64}, "size ... 2 numbers ... 64"),
        ({"glint_threshold": float("nan")}, "glint_threshold ... a finite number"),
        ({"glint_threshold": -1.0}, "glint_threshold must be 0 to"),
        ({"domain": float("inf")}, "domain ... 0 to 1e+07 m ... inf"),
        ({"domain": float("nan")}, "domain must be a finite number"),
        ({"sun_zenith": 85.0}, "sun_zenith ... 0 to 80 degrees ... 85"),
        ({"view_zenith": 75.0}, "view_zenith ... 0 to 70"),
        ({"sensor": THESIS.delayed(5.0)}, "time offsets of the bands must span at most"),
        (
            {"objects": (square(2.0, 1.0, 4.0, reflectance=0.1),)},
            "object must lie in the scene, 0 to 16 m right",
        ),
        ({"misregistration": ((0.0, 0.0),)}, "one (down, right) per band (8) ... 1"),
        ({"sky": "overcast"}, "is not one of uniform"),
        ({"domain": 2.0}, "grid must span at least one peak wave, 8.169 m"),
        ({"sensor": preset("micasense"), "wind": 18.0}, "facets ... at most 67108864, got"),
        ({"sensor": preset("sentinel2")}, "grid step must be at most"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(change, words):
    with pytest.raises(InputError) as caught:
        Facets(replace(SMALL, **({"size": (16, 16)} if change == {"domain": 2.0} else {}), **change))
    assert says(str(caught.value), *words.split(" ... "))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("reflectance", "depth"), [(2.0, 5.0), (0.1, -1.0)])
def test_impossible_objects_are_refused(reflectance, depth):
    with pytest.raises(InputError, match="must be"):
        square(5.0, 5.0, 2.0, reflectance=reflectance, depth=depth)


# Files and command


def test_written_scene_reads_back(tmp_path, moving):
    import rasterio

    from deglint.raster import simulated as writer

    files = writer.write_scene(moving, tmp_path / "sea.tif")
    names = sorted(p.name for p in tmp_path.iterdir())
    parts = ["", "_glint", "_glint_mask", "_objects", "_truth", "_truth_noisy", "_truth_water"]
    assert names == sorted([*(f"sea{p}.tif" for p in parts), "sea.json"])
    assert files[0].name == "sea.tif"
    with rasterio.open(tmp_path / "sea.tif") as image:
        np.testing.assert_array_equal(image.read(), moving.image)
        assert image.descriptions == tuple(b.name for b in THESIS.bands)
        assert image.scales[2] == pytest.approx(THESIS.scale(THESIS.bands[2]))
        assert image.tags(3) == {"wavelength": "545", "time_offset_s": "0.120"}
        assert image.tags()["FULL_SCALE"] == "4095"
        assert image.transform.a == 0.25
    with rasterio.open(tmp_path / "sea_truth.tif") as truth:
        np.testing.assert_array_equal(truth.read(), moving.truth)
    said = json.loads((tmp_path / "sea.json").read_text())
    assert said["setup"]["seed"] == 3
    assert said["setup"]["sensor"]["bands"][1]["time_offset"] == 0.06
    assert said["setup"]["air"]["visibility"] == 40.0
    with pytest.raises(WriteError, match="exists already"):
        writer.write_scene(moving, tmp_path / "sea")
    writer.write_scene(moving, tmp_path / "sea", overwrite=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == names


def test_a_failed_write_leaves_nothing(tmp_path, moving, monkeypatch):
    from deglint.raster import simulated as writer

    whole = writer.Layer.write

    def write(self, path, **options):
        if "_truth" in path.name:
            raise OSError("disk full")
        whole(self, path, **options)

    monkeypatch.setattr(writer.Layer, "write", write)
    with pytest.raises(WriteError, match="disk full"):
        writer.write_scene(moving, tmp_path / "sea")
    assert list(tmp_path.iterdir()) == []


def test_command_writes_one_scene(tmp_path):
    from click.testing import CliRunner

    from deglint.cli import simulate as module

    command = getattr(module, "simulate", module)
    arguments = [
        "--wind",
        "3",
        "--delay",
        "0.06",
        "--seed",
        "7",
        "--size",
        "48x64",
        "--json",
        "-q",
        "--misregistration",
        "0.3",
    ]
    done = CliRunner().invoke(command, [*arguments, str(tmp_path / "sea")])
    assert done.exit_code == 0, done.output
    files = json.loads(done.stdout)
    assert files[0] == str(tmp_path / "sea.tif")
    assert json.loads((tmp_path / "sea.json").read_text())["setup"]["size"] == [48, 64]
    assert {len(p) for p in json.loads((tmp_path / "sea.json").read_text())["setup"]["misregistration"]} == {2}
    again = CliRunner().invoke(command, [*arguments, str(tmp_path / "sea")])
    assert "exists already" in str(again.exception)
    wrong = CliRunner().invoke(command, ["--wind", "3", "--wind", "5", str(tmp_path / "other")])
    assert wrong.exit_code == 2
    assert "--grid" in wrong.output
    cut, outside = (
        CliRunner().invoke(command, [*arguments, "--dry-run", "--boat", boat, str(tmp_path / "other")])
        for boat in ("19,-3,0", "21,5,0")  # a boat of 8 m
    )
    assert (cut.exit_code, outside.exit_code) == (0, 2)
    assert says(outside.output, "--boat 21,5", "outside", "16 m wide", "12 m high")


def test_help_names_what_there_is():
    from importlib import import_module

    params = import_module("deglint.cli.simulate").simulate.params
    choices = {p.name: p.type.choices for p in params if isinstance(p.type, ChoiceFromTable)}
    assert choices == {"preset": tuple(PRESETS), "sky": sky.SKY_MODELS, "resampling": get_args(Kernel),
                       "slopes": get_args(SlopeModelName), "spectrum": get_args(waves.WaveSpectrum)}  # fmt: skip


@pytest.mark.slow
def test_a_grid_of_experiments_makes_its_directory(tmp_path, monkeypatch):
    from deglint.cli import run

    one = simulate(Setup(size=(32, 32)))
    monkeypatch.setattr("deglint.simulate.simulate", lambda setup, **_options: replace(one, setup=setup))
    out = tmp_path / "experiments"
    command = ["simulate", "--grid", "--size", "32", "--delay", "0", "--objects", "none", "--foam", "auto", "-q"]
    assert run([*command, "--wind", "5", "--wind", "12", str(out)]) == 0
    setups = [json.loads(path.read_text())["setup"] for path in out.glob("*.json")]
    assert len(setups) == 20  # two winds, five looks, two f-numbers
    assert {s["wind"]: s["foam"] for s in setups} == {wind: whitecaps(wind) for wind in (5.0, 12.0)}
    assert run(["simulate", "--grid", "--size", "32", "-q", str(tmp_path / "no" / "where")]) == 1


def test_the_command_takes_the_processors_of_its_process(monkeypatch, tmp_path):
    from deglint.cli import run

    seen = []

    def make(_setup, *, workers, **_options):
        seen.append(workers)
        raise InputError("enough")

    monkeypatch.setattr("os.cpu_count", lambda: 64)
    monkeypatch.setattr("os.sched_getaffinity", lambda _process: {0, 1, 2}, raising=False)
    monkeypatch.setattr("deglint.simulate.simulate", make)
    assert run(["simulate", str(tmp_path / "sea"), "-q"]) == 1
    assert seen == [3]
