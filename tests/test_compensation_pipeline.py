"""Compensation through files: errors on scenes with truth, what is flagged, tiles and threads, and doing no harm."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

import deglint as library
from deglint import Recipe, fit_scene, open_scene, remove_glint
from deglint import tiles as tiling
from deglint.compensate import THESIS
from deglint.errors import DeglintError, InputError
from deglint.physics.presets import preset
from deglint.pipeline.sidecar import load_chain, load_model
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, thesis_array

SCENES = Path(__file__).parents[2] / "shared" / "data" / "simulated"
shared = [
    pytest.mark.shared,
    pytest.mark.skipif(not SCENES.exists(), reason="the shared scenes do not lie beside the project"),
]
DEEP = 184
VISIBLE = 5
LIMITS = {
    "wind02_delay60": (2.8, 3.0), "wind05_delay60": (3.3, 3.6), "wind09_delay00": (3.6, 4.2),
    "wind09_delay60": (3.9, 5.0), "wind09_delay60_f30": (10.0, 12.0), "wind12_delay60_sun30": (18.0, 18.0),
}  # fmt: skip
"""Deep water and whole crop [%]."""
CHAIN = "psf:2, identify-level:13, replace-level, remove, identify-level:11, replace-level"


def values(path):
    return open_scene(path).read().astype(np.float64)


def error(image, truth, columns=None):
    """As `detect.bench.measure` has it: root mean square over the visible bands of RMSE / median(truth) [%]."""
    away = (image - truth)[:VISIBLE, :, :columns]
    each = np.sqrt((away**2).mean(axis=(1, 2))) / np.median(truth[:VISIBLE], axis=(1, 2))
    return 100 * np.sqrt((each**2).mean())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Scenes by wind, delay and seed, made once."""
    place, known = tmp_path_factory.mktemp("scenes"), {}

    def make(wind=9.0, delay=0.06, seed=0, size=160, objects=True):
        key = f"w{wind:g}_{1000 * delay:g}_{seed}_{size}_{objects}"
        if key not in known:
            things = thesis_array((size, size), 0.25, sides=(16,)) if objects else ()
            sensor = preset("thesis").delayed(delay)
            scene = simulate(Setup(sensor=sensor, size=(size, size), wind=wind, sky="cardioidal", patch=0.06, seed=seed,
                                   objects=things))  # fmt: skip
            write_scene(scene, place / key)
            known[key] = place / f"{key}.tif", scene
        return known[key]

    return make


# ------------------------------------------------------------------------------------------------ errors with truth


@pytest.mark.parametrize("name", LIMITS)
def test_default_on_recorded_scenes(name, tmp_path):
    result = remove_glint(SCENES / f"{name}.tif", tmp_path / "out.tif")
    out, truth = values(tmp_path / "out.tif"), values(SCENES / f"{name}_truth.tif")
    deep, whole = LIMITS[name]
    assert error(out, truth, DEEP) < deep
    assert error(out, truth) < whole
    assert result.fitted.needs.simultaneous == (name == "wind09_delay00")


@pytest.mark.parametrize("name", LIMITS)
def test_thesis_chain_is_what_another_program_recorded(name, tmp_path):
    recorded = json.loads((SCENES / "trial_errors.json").read_text())[name]["thesis+joyce"]["deep"]
    recipe = Recipe(method="joyce", compensate="thesis", sample="0,0,184,384", mask="none")
    remove_glint(SCENES / f"{name}.tif", tmp_path / "out.tif", recipe)
    found = error(values(tmp_path / "out.tif"), values(SCENES / f"{name}_truth.tif"), DEEP)
    assert found == pytest.approx(recorded, rel=0.05)


for test in (test_default_on_recorded_scenes, test_thesis_chain_is_what_another_program_recorded):
    test.pytestmark = [*test.pytestmark, *shared]


@pytest.mark.parametrize(
    ("wind", "delay", "seed"),
    [(2.0, 0.06, 1), (5.0, 0.06, 2), (9.0, 0.06, 1), (9.0, 0.06, 2), (12.0, 0.06, 1), (9.0, 0.0, 2)],
)
def test_no_band_that_is_changed_gets_worse(made, tmp_path, wind, delay, seed):
    source, scene = made(wind, delay, seed)
    remove_glint(source, tmp_path / "out.tif")
    before, after, truth = values(source), values(tmp_path / "out.tif"), scene.truth
    for b in range(len(truth)):
        if (before[b] != after[b]).any():
            was, now = (np.sqrt(((x[b] - truth[b]) ** 2).mean()) for x in (before, after))
            assert now < was
    assert error(after, truth) < 0.2 * error(before, truth)


@pytest.mark.parametrize(("wind", "seed"), [(1.0, 1), (5.0, 2), (9.0, 3)])
def test_a_scene_without_glint_passes_bit_for_bit(made, read, tmp_path, wind, seed):
    source, scene = made(wind, seed=seed, objects=False)
    calm = source.with_name(f"{source.stem}_truth_noisy.tif")
    result = remove_glint(calm, tmp_path / "out.tif", flags=tmp_path / "f.tif")
    np.testing.assert_array_equal(read(tmp_path / "out.tif"), scene.truth_image)
    assert not result.fitted.chain.runs
    assert any("compensation: skipped, glint adds at most" in note for note in result.fitted.notes)
    assert not (read(tmp_path / "f.tif") & 64).any()


# ------------------------------------------------------------------------------------------------ what is done where


def test_off_is_the_plain_method(made, read, tmp_path):
    source, _ = made()
    raw = open_scene(source).read()
    for method in ("hedley", "lyzenga", "joyce", "multiband"):
        recipe = Recipe(method=method, compensate="off", sample="all", mask="none")
        result = remove_glint(source, tmp_path / "out.tif", recipe, overwrite=True, dtype="float32")
        bands = open_scene(source).bands
        model = library.fit(method, raw, nir=6, bands=bands)
        assert result.fitted.model.fits == model.fits
        np.testing.assert_allclose(values(tmp_path / "out.tif"), library.apply(raw, model), rtol=3e-7)  # scales
        assert not result.fitted.chain.runs


def test_flags_say_what_was_replaced_and_nothing_else_changes(made, read, tmp_path):
    source, scene = made()
    chain = "identify-level:13, replace-level"
    recipe = Recipe(method="hedley", compensate=chain, mask="none", bands=("GREEN",), sample="all")
    result = remove_glint(source, tmp_path / "out.tif", recipe, flags=tmp_path / "f.tif")
    out, flags = read(tmp_path / "out.tif"), read(tmp_path / "f.tif")[0]
    others = [b for b in range(8) if b != 2]
    np.testing.assert_array_equal(out[others], scene.image[others])
    assert result.tally.replaced[others].sum() == 0
    assert result.tally.replaced[2] == (flags & 64 > 0).sum() > 0
    # without a removal only what is flagged differs
    recipe = Recipe(method="joyce", compensate=chain + ", remove", mask="none", sample="all")
    made_of = remove_glint(source, tmp_path / "all.tif", recipe, flags=tmp_path / "f.tif", overwrite=True)
    nir, flags = read(tmp_path / "all.tif")[6:], read(tmp_path / "f.tif")[0]
    assert 6 not in [f.band for f in made_of.fitted.model.fits]
    changed = (nir != scene.image[6:]).any(axis=0)
    assert not changed[flags & (64 | 128) == 0].any()
    assert (flags & 64 > 0).sum() >= made_of.tally.replaced.max()


@pytest.mark.parametrize(
    ("compensate", "sample"),
    [
        ("auto", "auto"), ("auto", "20,10,120,130"), ("thesis", "auto"), ("thesis", "all"), (CHAIN, "all"),
        ("remove, identify-level:11, replace-level", "all"),
    ],
)  # fmt: skip
def test_tiles_and_threads_do_not_show(made, read, tmp_path, monkeypatch, compensate, sample):
    source, _ = made(size=192)
    recipe, found = Recipe(compensate=compensate, sample=sample), []
    strips = tmp_path / "strips.tif"
    with (
        rasterio.open(source) as data,
        rasterio.open(
            strips, "w", **(data.profile | {"tiled": False, "blockysize": 1, "blockxsize": 192, "compress": None})
        ) as out,
    ):
        out.write(data.read())
        out.update_tags(**data.tags())
        out.descriptions, out.scales = data.descriptions, data.scales
        for b in range(1, 9):
            out.update_tags(b, **data.tags(b))
    for file, threads, samples in (
        (source, 1, None),
        (source, 3, None),
        (source, 2, 64 * 64 * 8),
        (strips, 1, 64 * 192 * 8),
    ):
        if samples:
            monkeypatch.setattr(tiling, "SAMPLES", samples)
            monkeypatch.setattr(tiling, "COMPACT", 64)
        result = remove_glint(file, tmp_path / "out.tif", recipe, threads=threads, overwrite=True)
        found.append((read(tmp_path / "out.tif"), result.fitted.model, result.fitted.chain.saved()))
    for image, model, chain in found[1:]:
        assert model == found[0][1]
        assert json.dumps(chain) == json.dumps(found[0][2])
        np.testing.assert_array_equal(image, found[0][0])


def test_stages_after_the_removal_alone_are_applied(made, read, tmp_path):
    source, _ = made(delay=0.0)
    after = Recipe(method="joyce", compensate="remove, identify-level:11, replace-level", mask="none", sample="all")
    plain = Recipe(method="joyce", compensate="off", mask="none", sample="all")
    done = remove_glint(source, tmp_path / "after.tif", after, model_file=tmp_path / "m.json", flags=tmp_path / "f.tif")
    remove_glint(source, tmp_path / "plain.tif", plain)
    replaced = read(tmp_path / "f.tif")[0] & 64 > 0
    different = (read(tmp_path / "after.tif") != read(tmp_path / "plain.tif")).any(axis=0)
    assert different.any()
    assert not different[~replaced].any()
    assert [s.name for s in done.fitted.chain.after] == ["identify-level", "replace-level"]
    saved = str(tmp_path / "m.json")
    again = remove_glint(
        source, tmp_path / "again.tif", Recipe(mask="none"), model=load_model(saved), chain=load_chain(saved)
    )
    np.testing.assert_array_equal(read(tmp_path / "again.tif"), read(tmp_path / "after.tif"))
    assert again.fitted.chain.runs


@pytest.mark.parametrize("compensate", ["auto", "thesis"])
def test_a_saved_fit_gives_the_same_bits(deglint, made, read, tmp_path, compensate):
    source, _ = made()
    first = deglint(
        "remove", source, tmp_path / "a.tif", "--compensate", compensate, "--save-model", tmp_path / "m.json"
    )
    assert first.code == 0
    json.loads((tmp_path / "m.json").read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert deglint("remove", source, tmp_path / "b.tif", "--model", tmp_path / "m.json").code == 0
    np.testing.assert_array_equal(read(tmp_path / "a.tif"), read(tmp_path / "b.tif"))
    one, other = (json.loads((tmp_path / f"{n}.tif.json").read_text()) for n in "ab")
    assert one["compensation"] == other["compensation"]
    off = deglint("remove", source, tmp_path / "c.tif", "--model", tmp_path / "m.json", "--compensate", "off")
    assert off.code == 0
    assert (read(tmp_path / "c.tif") != read(tmp_path / "a.tif")).any()


# ------------------------------------------------------------------------------------------------ awkward scenes


def subset(source, target, bands, change=None, **options):
    """Some bands of a scene, their numbers changed."""
    with rasterio.open(source) as data:
        block = data.read([b + 1 for b in bands])
        if change is not None:
            block = change(block)
        profile = data.profile | {"count": len(bands), "dtype": block.dtype.name} | options
        with rasterio.open(target, "w", **profile) as out:
            out.write(block)
            out.update_tags(**data.tags())
            out.descriptions = [data.descriptions[b] for b in bands]
            out.scales = [data.scales[b] for b in bands]
            for i, b in enumerate(bands, start=1):
                out.update_tags(i, **data.tags(b + 1))
    return block


@pytest.mark.parametrize("mask", ["auto", "area"])
def test_tiles_without_water_or_beyond_the_mask_are_passed_as_they_are(made, read, tmp_path, monkeypatch, mask):
    source, _ = made()
    land = np.random.default_rng(0).integers(2500, 3500, (8, 320, 480))

    def beside(block):
        land[:, :160, :160] = block
        land[:, :160, 160:320] = block[:, :, ::-1]
        return land.astype(np.uint16)

    scene = tmp_path / "coast.tif"
    subset(source, scene, range(8), beside, width=480, height=320)
    given = tmp_path / "area.tif"
    with (
        rasterio.open(scene) as data,
        rasterio.open(given, "w", **(data.profile | {"count": 1, "dtype": "uint8"})) as out,
    ):
        sea = np.zeros((320, 480), np.uint8)
        sea[:160, :320] = 1
        out.write(sea, 1)
    recipe = Recipe(mask="auto" if mask == "auto" else str(given))
    whole = remove_glint(scene, tmp_path / "whole.tif", recipe)
    monkeypatch.setattr(tiling, "SAMPLES", 64 * 64 * 8)
    monkeypatch.setattr(tiling, "COMPACT", 64)
    tiled = remove_glint(scene, tmp_path / "tiled.tif", recipe)
    found = read(tmp_path / "tiled.tif")
    np.testing.assert_array_equal(found, read(tmp_path / "whole.tif"))
    np.testing.assert_array_equal(found[:, 160:], land[:, 160:])
    assert (found[:, :160, :320] != land[:, :160, :320]).mean() > 0.3
    assert whole.tally.passed == 0
    assert tiled.tally.passed > 0.1 * tiled.tally.total
    assert "lie in tiles where nothing is to be corrected" in tiled.sidecar["skipped"]["compensation"]
    assert (tiled.tally.not_water, tiled.tally.corrected) == (whole.tally.not_water, whole.tally.corrected)


@pytest.mark.parametrize("compensate", ["auto", "thesis", CHAIN])
def test_holes_stay_and_do_not_spread(made, read, tmp_path, compensate):
    source, scene = made()
    holes = np.zeros((160, 160), bool)
    holes[:30, :40] = holes[100:120, 70:71] = holes[159, 159] = True

    def pierce(block):
        block[:, holes] = 0
        return block

    raw = subset(source, tmp_path / "in.tif", range(8), pierce, nodata=0)
    remove_glint(tmp_path / "in.tif", tmp_path / "out.tif", Recipe(compensate=compensate), flags=tmp_path / "f.tif")
    out, flags = read(tmp_path / "out.tif"), read(tmp_path / "f.tif")[0]
    np.testing.assert_array_equal(out[:, holes], raw[:, holes])
    np.testing.assert_array_equal(flags == 1, holes)
    clean, truth = values(tmp_path / "out.tif")[:, ~holes], scene.truth[:, ~holes]
    assert np.isfinite(clean).all()
    assert ((clean - truth)[:5] ** 2).mean() < 0.1 * ((values(source)[:, ~holes] - truth)[:5] ** 2).mean()


@pytest.mark.parametrize("bands", [(6,), (2, 6), (2, 5, 6)])
def test_few_bands(made, read, tmp_path, bands):
    source, scene = made()
    raw = subset(source, tmp_path / "in.tif", bands)
    if len(bands) == 1:
        with pytest.raises(DeglintError) as found:
            remove_glint(tmp_path / "in.tif", tmp_path / "out.tif")
        assert "\n" not in str(found.value)
        return
    result = remove_glint(tmp_path / "in.tif", tmp_path / "out.tif")
    truth = scene.truth[bands[0]]
    was, now = (np.sqrt(((values(p)[0] - truth) ** 2).mean()) for p in (tmp_path / "in.tif", tmp_path / "out.tif"))
    assert now < 0.3 * was
    assert result.fitted.chain.runs
    assert raw.shape[0] == len(bands)


def test_no_nir_is_said_as_before(made, tmp_path):
    subset(made()[0], tmp_path / "in.tif", (0, 1, 2, 3, 4))
    messages = []
    for compensate in ("off", "auto", "thesis"):
        with pytest.raises(DeglintError, match="no near-infrared band") as found:
            remove_glint(tmp_path / "in.tif", tmp_path / "out.tif", Recipe(compensate=compensate))
        messages.append(str(found.value))
    assert len(set(messages)) == 1


@pytest.mark.parametrize("compensate", ["auto", "thesis", CHAIN])
def test_a_scene_that_is_saturated_all_over_ends_in_one_line(deglint, made, tmp_path, compensate):
    subset(made()[0], tmp_path / "in.tif", range(8), lambda block: np.full_like(block, 4095))
    ran = deglint("remove", tmp_path / "in.tif", tmp_path / "out.tif", "--compensate", compensate)
    assert ran.code in (1, 3)
    assert "Traceback" not in ran.err
    assert not (tmp_path / "out.tif").exists()


def test_nearly_all_glint_works_and_warns(made, tmp_path):
    rng = np.random.default_rng(0)

    def flood(block):
        more = rng.gamma(1.5, 60.0, block.shape) * (rng.random(block.shape) < 0.9)
        return np.minimum(block + more, 4095).astype(np.uint16)

    source, scene = made(5.0)
    subset(source, tmp_path / "in.tif", range(8), flood)
    result = remove_glint(tmp_path / "in.tif", tmp_path / "out.tif", Recipe(mask="none", sample="all"))
    assert any("of the middlemost band (more than 60%): much of it will be left" in w for w in result.warnings)
    assert error(values(tmp_path / "out.tif"), scene.truth) < 0.5 * error(values(tmp_path / "in.tif"), scene.truth)


def test_sharp_optics_are_not_sharpened(tmp_path):
    sensor = replace(preset("thesis").delayed(0.06), f_number=2.0, smear=0.0)
    seen = simulate(Setup(sensor=sensor, size=(160, 160), wind=9.0, sky="cardioidal", patch=0.06))
    path = write_scene(seen, tmp_path / "sharp")[0]
    stages = {s.stage: s for s in fit_scene(open_scene(path), Recipe(sample="all", mask="none")).needs.stages}
    assert not stages["psf"].runs
    assert "threshold 90%" in stages["psf"].why
    assert stages["opening"].runs


def test_sizes_of_objects_decide_on_the_element(made, deglint, tmp_path):
    source, _ = made()
    found = {}
    for size in ("4m", "2m", "16px", "1m"):
        fitted = fit_scene(open_scene(source), Recipe(smallest_object=size))
        found[size] = [s.size for s in fitted.chain.before if s.name == "identify-level"]
    assert found == {"4m": [13], "2m": [5], "16px": [13], "1m": []}
    ran = deglint("remove", source, tmp_path / "out.tif", "--smallest-object", "big")
    assert ran.code in (1, 2)
    assert "'big' is not a width such as 4m or 16px" in ran.err
    with pytest.raises(InputError, match="stage 'sharpen' is not one of"):
        Recipe(compensate="sharpen")
    assert THESIS.endswith("remove")


@pytest.mark.parametrize("odd", [False, True])
def test_a_tile_that_is_all_rewritten_lets_its_own_numbers_go_and_reads_them_again_if_need_be(
    made, tmp_path, monkeypatch, odd
):
    """Of physical values in single precision; where a result were not finite the file's number would be kept."""
    import deglint.pipeline.correct as module

    path, _ = made()
    with rasterio.open(path) as given:
        numbers = (given.read() * np.array(given.scales)[:, None, None]).astype(np.float32)
        profile = given.profile | {"dtype": "float32", "nodata": None}
        tags, each, names = given.tags(), [given.tags(b) for b in given.indexes], given.descriptions
    with rasterio.open(tmp_path / "float.tif", "w", **profile) as out:
        out.write(numbers)
        out.update_tags(**tags)
        out.descriptions = names
        for b, told in enumerate(each, 1):
            out.update_tags(b, **told)
    recipe = Recipe(mask="none", compensate=CHAIN)
    remove_glint(tmp_path / "float.tif", tmp_path / "plain.tif", recipe)
    read, seen = module.raster_of(open_scene(path)).__class__.read_raw, []

    def counted(self, window):
        seen.append(window)
        return read(self, window)

    monkeypatch.setattr(module.raster_of(open_scene(path)).__class__, "read_raw", counted)
    if odd:
        monkeypatch.setattr(module.Correction, "_least", lambda *_: np.full(8, np.nan))
    remove_glint(tmp_path / "float.tif", tmp_path / "again.tif", recipe)
    assert values(tmp_path / "again.tif").tobytes() == values(tmp_path / "plain.tif").tobytes()
    whole = ((0, values(path).shape[1]), (0, values(path).shape[2]))
    assert seen.count(whole) == 1 + odd  # one tile, which holds the whole scene
