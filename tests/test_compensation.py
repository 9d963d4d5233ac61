"""Compensation end to end, on small scenes of the simulator: error, flags, and the same bits however it runs."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import rasterio

from deglint import Recipe, correct, fit_scene, open_scene, remove_glint
from deglint.errors import DeglintError
from deglint.pipeline import load_chain, load_model
from deglint.raster.simulated import write_scene

from .common import at_wavelengths, simulated_squares, write_bare

SIDE = 192
OPENING = "psf:2, identify-level:13, targets, replace-level, remove"
POSTERIOR = "targets, remove, posterior"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Scenes by delay, made once: the file, and the truth."""
    place = tmp_path_factory.mktemp("seas")

    @cache
    def make(delay=0.06):
        scene = simulated_squares(SIDE, 7.0, delay, seed=11)
        write_scene(scene, place / f"delay{1000 * delay:g}", overwrite=True, truth=False)
        return place / f"delay{1000 * delay:g}.tif", scene.truth.astype(np.float64)

    return make


def error(path, truth, bands=5):
    """Root mean square error of the visible bands, of the water's level."""
    clean = open_scene(path).read().astype(np.float64)
    level = np.median(truth, axis=(1, 2))
    return float(
        np.sqrt(np.mean([(((c - t) / m) ** 2).mean() for c, t, m in zip(clean[:bands], truth, level, strict=False)]))
    )


@pytest.mark.parametrize(("delay", "limit"), [(0.0, 0.06), (0.06, 0.06)])
def test_the_default_brings_the_water_back(made, tmp_path, delay, limit):
    path, truth = made(delay)
    assert error(path, truth) > 1
    result = remove_glint(path, tmp_path / "out.tif")
    assert error(tmp_path / "out.tif", truth) < limit, result.fitted.choice.lines()


@pytest.mark.parametrize("chain", ["auto", "thesis"])
def test_a_band_of_classes_is_copied_and_changes_no_other(made, tmp_path, chain):
    """It has no wavelength, no blur and no time, and its numbers are no light."""
    path, truth = made()
    with rasterio.open(path) as source:
        profile, bands, tags = source.profile, source.read(), source.tags()
        own = [source.tags(i) for i in source.indexes]
        names, scales = source.descriptions, source.scales
    classes = np.zeros_like(bands[:1])
    classes[:, ::9] = 7
    profile.update(count=len(bands) + 1)
    with rasterio.open(tmp_path / "in.tif", "w", **profile) as more:
        more.write(np.concatenate([bands, classes]))
        more.descriptions, more.scales = (*names, "classes"), (*scales, 1.0)
        more.update_tags(**tags)
        for i, facts in enumerate(own, start=1):
            more.update_tags(i, **facts)
    recipe = Recipe(compensate=chain)
    alone = remove_glint(path, tmp_path / "alone.tif", recipe)
    beside = remove_glint(tmp_path / "in.tif", tmp_path / "beside.tif", recipe)
    assert beside.fitted.chain.text == alone.fitted.chain.text
    found = open_scene(tmp_path / "beside.tif").read()
    np.testing.assert_array_equal(found[len(bands) :], classes)
    if chain == "auto":
        assert error(tmp_path / "beside.tif", truth) == pytest.approx(error(tmp_path / "alone.tif", truth), rel=0.02)
    else:
        np.testing.assert_array_equal(found[: len(bands)], open_scene(tmp_path / "alone.tif").read())


@pytest.mark.slow
@pytest.mark.parametrize("chain", [OPENING, POSTERIOR, "thesis"])
def test_the_same_bits_however_a_scene_is_stored_and_read(made, tmp_path, chain):
    path, _ = made()
    with rasterio.open(path) as source:
        profile, data, tags = source.profile, source.read(), [source.tags(i) for i in source.indexes]
        scales, offsets, names, more = source.scales, source.offsets, source.descriptions, source.tags()
    big = np.tile(data, (1, 3, 3))
    seen = []
    for name, layout in {
        "tiled": {"tiled": True, "blockxsize": 256, "blockysize": 128},
        "strips": {"tiled": False},
    }.items():
        file = tmp_path / f"{name}.tif"
        options = {k: v for k, v in profile.items() if k not in ("blockxsize", "blockysize", "tiled", "interleave")}
        with rasterio.open(file, "w", **options | layout | {"height": big.shape[1], "width": big.shape[2]}) as target:
            target.write(big)
            target.scales, target.offsets, target.descriptions = scales, offsets, names
            target.update_tags(**more)
            for i, own in enumerate(tags, start=1):
                target.update_tags(i, **own)
        out = tmp_path / f"{name}_out.tif"
        result = remove_glint(file, out, Recipe(compensate=chain), threads=len(seen) + 1)
        with rasterio.open(out) as clean:
            seen.append(clean.read())
    assert np.array_equal(*seen)
    scene, fitted = open_scene(tmp_path / "tiled.tif"), result.fitted
    whole = correct(scene, fitted)
    assert np.array_equal(correct(scene, fitted, window=((30, 200), (490, 570))), whole[:, 30:200, 490:570])


@pytest.mark.slow
@pytest.mark.parametrize("chain", [OPENING, POSTERIOR])
def test_a_saved_chain_gives_the_same_result(made, tmp_path, chain):
    path, _ = made()
    out, model = tmp_path / "out.tif", tmp_path / "model.json"
    remove_glint(path, out, Recipe(compensate=chain), model_file=model)
    again = tmp_path / "again.tif"
    remove_glint(path, again, model=load_model(str(model)), chain=load_chain(str(model)))
    assert np.array_equal(open_scene(out).read(), open_scene(again).read())


def test_a_saved_chain_is_json_without_infinity(sea, write, tmp_path):
    path, file = write(tmp_path / "sea.tif", sea(dtype="float32")), tmp_path / "model.json"
    recipe = Recipe(method="hedley", compensate="remove, posterior:3")
    chain = remove_glint(path, tmp_path / "out.tif", recipe, model_file=file).fitted.chain
    assert "Infinity" not in file.read_text()
    assert np.isinf(chain.after[0].saturation).all()
    assert load_chain(str(file)) == chain


def test_errors_need_the_level_before_the_removal(sea, write, tmp_path):
    recipe = Recipe(method="hedley", compensate="remove, identify-level:9, replace-level")
    with pytest.raises(DeglintError, match=r"identify-level.*replace-level before remove"):
        remove_glint(write(tmp_path / "sea.tif", sea()), tmp_path / "out.tif", recipe, stderr=tmp_path / "errors.tif")


def test_errors_of_pixels_that_are_identified_but_not_replaced_include_what_removal_leaves(sea, write, tmp_path):
    path, errors = write(tmp_path / "sea.tif", sea()), []
    for chain in ("remove", "identify-level:9, remove"):
        out = tmp_path / f"{len(errors)}.tif"
        recipe = Recipe(method="hedley", compensate=chain)
        remove_glint(path, tmp_path / "out.tif", recipe, stderr=out, overwrite=True)
        errors.append(open_scene(out).read())
    np.testing.assert_allclose(*errors, rtol=1e-5)


def test_a_saved_chain_of_an_earlier_version_is_refused(made, tmp_path):
    path, _ = made()
    file = tmp_path / "old.json"
    remove_glint(path, tmp_path / "out.tif", Recipe(method="hedley"), model_file=file)
    old = {"compensation": {"chain": "x", "before": [{"stage": "identify-level"}], "after": []}}
    file.write_text(json.dumps(json.loads(file.read_text()) | old))
    with pytest.raises(DeglintError, match=r"save.*again"):
        load_chain(str(file))


def test_flags_and_counts_agree(made, tmp_path):
    path, _ = made()
    result = remove_glint(path, tmp_path / "out.tif", Recipe(compensate=OPENING), flags=tmp_path / "flags.tif")
    with rasterio.open(tmp_path / "flags.tif") as source:
        flags = source.read(1)
    assert np.count_nonzero(flags & 4) == result.sidecar["pixels"]["corrected"]
    assert np.count_nonzero(flags & 128) == result.sidecar["pixels"]["protected"]
    assert np.count_nonzero(flags & 64) >= max(result.sidecar["pixels"]["replaced"].values())


def test_only_bands_that_are_written_count_as_replaced(made, tmp_path):
    path, _ = made()
    with rasterio.open(path) as dataset:
        name = dataset.descriptions[1]
        assert "MEANING" in dataset.tags()
    result = remove_glint(path, tmp_path / "out.tif", Recipe(compensate=OPENING, bands=(name,)))
    replaced = result.sidecar["pixels"]["replaced"]
    assert [band for band, count in replaced.items() if count] == [name]
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert "MEANING" not in dataset.tags()


def written(path, array, scene):
    tags = [{"wavelength": b.wavelength, "time_offset_s": b.time_offset} for b in scene.bands]
    return write_bare(path, array, names=scene.names, band_tags=tags)


def test_what_is_not_valid_stays_as_it_is(made, tmp_path):
    path, _ = made()
    scene = open_scene(path)
    values = scene.read().astype(np.float32)
    values[:, 40:60, 50:90] = np.nan
    remove_glint(written(tmp_path / "holes.tif", values, scene), tmp_path / "out.tif", Recipe(compensate=OPENING))
    clean = open_scene(tmp_path / "out.tif").read()
    assert np.isnan(clean[:, 40:60, 50:90]).all()
    assert np.isfinite(clean).sum() == np.isfinite(values).sum()


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["uint8", "float64"])
def test_scenes_of_other_types_are_compensated(made, tmp_path, dtype):
    path, truth = made()
    scene = open_scene(path)
    values = scene.read()
    factor = 250 / np.percentile(values, 99, axis=(1, 2), keepdims=True) if dtype == "uint8" else 1.0
    array = np.clip(np.rint(values * factor), 1, 255) if dtype == "uint8" else values
    result = remove_glint(written(tmp_path / "other.tif", array.astype(dtype), scene), tmp_path / "out.tif")
    clean = open_scene(tmp_path / "out.tif").read().astype(float)
    assert np.isfinite(clean).all()
    before, after = (np.abs(x - truth * factor)[:5].mean() for x in (array, clean))
    assert after < 0.5 * before, result.fitted.choice.lines()


def few_bands(made, tmp_path, bands):
    path, _ = made()
    scene = open_scene(path)
    few = [scene.bands[b] for b in bands]
    return write_bare(tmp_path / "few.tif", scene.read().astype("float32")[list(bands)],
                      names=[b.name for b in few], band_tags=at_wavelengths(*(b.wavelength for b in few)))  # fmt: skip


def test_two_bands_are_enough(made, tmp_path):
    remove_glint(few_bands(made, tmp_path, (2, 6)), tmp_path / "out.tif")
    assert np.isfinite(open_scene(tmp_path / "out.tif").read()).all()


def test_one_band_is_refused_in_one_line(made, tmp_path):
    with pytest.raises(DeglintError, match=r"^[^\n]*band[^\n]*$"):
        remove_glint(few_bands(made, tmp_path, (6,)), tmp_path / "out.tif")


@pytest.mark.parametrize("size", [(1, 40), (9, 9), (40, 17)])
def test_scenes_smaller_than_the_window(made, tmp_path, size):
    path, _ = made()
    scene = open_scene(path)
    fitted = fit_scene(scene, Recipe(compensate=OPENING))
    small = replace(scene, height=size[0], width=size[1])
    assert correct(small, fitted).shape == (len(scene.bands), *size)
