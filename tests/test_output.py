"""The files that come out: tags, layout, options, pictures, sidecars - against checks of other programs."""

import json
import os
import stat
import zlib

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.control import GroundControlPoint
from rasterio.enums import ColorInterp
from rasterio.rpc import RPC

import deglint as library
from deglint import Recipe, remove_glint
from deglint.errors import WriteError

from .common import PLAIN, RUN


def everything(dataset):
    dataset.update_tags(AREA_OR_POINT="Point", MISSION="North", **{f"K{i}": "v" * 150 for i in range(120)})
    dataset.update_tags(ns="MINE", a="b")
    for band in dataset.indexes:
        dataset.update_tags(band, wavelength=str((490, 560, 660, 842)[band - 1]), long="y" * 400)
        dataset.update_tags(band, ns="BANDS", own=str(band))
    dataset.scales, dataset.offsets, dataset.units = [1e-4, 2e-4, 3e-4, 4e-4], [0, 1, 2, 3], ["a", "b", "c", "d"]
    dataset.colorinterp = [ColorInterp.blue, ColorInterp.green, ColorInterp.red, ColorInterp.undefined]


def test_everything_about_the_file_is_kept(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(), describe=everything, nodata=1)
    remove_glint(source, tmp_path / "out.tif", PLAIN)
    with rasterio.open(source) as old, rasterio.open(tmp_path / "out.tif") as new:
        for name in ("crs", "transform", "descriptions", "units", "scales", "offsets", "nodatavals", "dtypes",
                     "colorinterp", "shape", "bounds", "res"):  # fmt: skip
            assert getattr(new, name) == getattr(old, name), name
        assert new.tags() == old.tags()
        assert new.tags(ns="MINE") == {"a": "b"}
        for band in old.indexes:
            assert new.tags(band) == old.tags(band)
            assert new.tags(band, ns="BANDS") == {"own": str(band)}
    assert not (tmp_path / "out.tif.aux.xml").exists()


def test_old_statistics_are_not_kept(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(), describe=lambda d: d.update_tags(1, STATISTICS_MEAN="5", KEPT="1"))
    remove_glint(source, tmp_path / "out.tif", PLAIN)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.tags(1) == {"KEPT": "1"}


@pytest.mark.parametrize("known", [True, False], ids=["with a CRS", "without"])
def test_ground_control_points_and_rational_polynomials_are_kept(sea, write, tmp_path, known):
    points = [
        GroundControlPoint(r, c, 134 + c / 1e4, 7 - r / 1e4, 5.0) for r, c in [(0, 0), (0, 99), (79, 0), (79, 99)]
    ]
    rpc = RPC(height_off=1, height_scale=2, lat_off=3, lat_scale=4, line_off=5, line_scale=6, long_off=7, long_scale=8,
              samp_off=9, samp_scale=10, line_num_coeff=list(range(20)), line_den_coeff=[1.5] * 20,
              samp_num_coeff=[2.5] * 20, samp_den_coeff=list(range(20)), err_bias=0.5, err_rand=0.25)  # fmt: skip

    def describe(dataset):
        dataset.gcps = points, rasterio.crs.CRS.from_epsg(4326) if known else rasterio.crs.CRS()
        dataset.rpcs = rpc

    source = write(tmp_path / "in.tif", sea(), crs=None, transform=None, describe=describe)
    remove_glint(source, tmp_path / "out.tif", PLAIN)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        found, crs = dataset.gcps
        assert [(p.row, p.col, p.x, p.y, p.z) for p in found] == [(p.row, p.col, p.x, p.y, p.z) for p in points]
        assert crs.to_epsg() == 4326 if known else not crs
        assert dataset.rpcs.to_dict() == rpc.to_dict()


def layout_of(path):
    """Where the file's parts lie, read by hand: (end of the last directory and its values, first byte of data)."""
    data = path.read_bytes()
    big = data[2] == 43
    size, count_size, entry, first = (8, 8, 20, 8) if big else (4, 2, 12, 4)
    widths = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
    order = "little" if data[:2] == b"II" else "big"

    def number(at, length):
        return int.from_bytes(data[at : at + length], order)

    at, headers, blocks = number(first, size), 0, []
    while at:
        entries = number(at, count_size)
        for k in range(entries):
            e = at + count_size + k * entry
            tag, kind, n = number(e, 2), number(e + 2, 2), number(e + 4, size)
            place = e + 4 + size
            if n * widths[kind] > size:
                place = number(place, size)
                headers = max(headers, place + n * widths[kind])
            if tag in (273, 324):
                blocks += [number(place + i * widths[kind], widths[kind]) for i in range(n)]
        headers = max(headers, at + count_size + entries * entry + size)
        at = number(at + count_size + entries * entry, size)
    return headers, min(b for b in blocks if b)


LAYOUTS = {
    "plain": {},
    "tags": {"describe": everything},
    "mask": {"mask": True},
    "tags and mask": {"describe": everything, "mask": True, "interleave": "pixel"},
    "deflate": {"compress": "deflate", "predictor": 2},
    "zstd in small tiles": {"compress": "zstd", "tiled": True, "blockxsize": 64, "blockysize": 80},
    "lzw by pixel": {"compress": "lzw", "interleave": "pixel"},
    "nodata": {"nodata": 0},
    "packbits and mask": {"compress": "packbits", "mask": True},
}


@pytest.mark.slow
@pytest.mark.parametrize("size", [(80, 100), (600, 530), (1, 1)], ids=["small", "large", "one pixel"])
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_outputs_are_cloud_optimised(sea, write, tmp_path, layout, size):
    cogeo = pytest.importorskip("rio_cogeo")
    layout = dict(layout)
    if layout.get("mask"):
        layout["mask"] = np.tri(*size, dtype=np.uint8) * 255
    source = write(tmp_path / "in.tif", sea(*size), **layout)
    model = library.fit("hedley", sea(), nir=3, bands=library.open_scene(source).bands)
    remove_glint(source, tmp_path / "out.tif", Recipe(mask="none"), model=model,
                 flags=tmp_path / "flags.tif", amount=tmp_path / "amount.tif")  # fmt: skip
    for name in ("out.tif", "flags.tif", "amount.tif"):
        valid, errors, warnings = cogeo.cog_validate(tmp_path / name, quiet=True)
        assert (valid, errors) == (True, [])
        assert all("overviews" in w for w in warnings)
        headers, data = layout_of(tmp_path / name)
        assert headers <= data
    with rasterio.open(source) as old, rasterio.open(tmp_path / "out.tif") as new:
        assert new.profile.get("compress") == old.profile.get("compress")
        assert new.profile["interleave"] == old.profile["interleave"]


def test_creation_options_win_and_keep_their_case(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(), compress="deflate")
    options = ("COMPRESS=LZW", "BIGTIFF=YES", "blockxsize=64", "BLOCKYSIZE=32", "INTERLEAVE=BAND")
    co = [word for option in options for word in ("--co", option)]
    assert deglint("remove", source, tmp_path / "out.tif", *RUN, *co).code == 0
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.profile["compress"] == "lzw"
        assert dataset.block_shapes[0] == (32, 64)
        assert dataset.profile["interleave"] == "band"
    assert (tmp_path / "out.tif").read_bytes()[2] == 43
    assert cli_options() == {"COMPRESS": "ZSTD", "Level": "aB=c"}


def cli_options():
    from deglint.cli.options import creation_options

    return creation_options(None, None, ("COMPRESS=ZSTD", "Level=aB=c"))


@pytest.mark.parametrize("option", ["COMPRESS=MAGIC", "BLOCKXSIZE=17", "INTERLEAVE=SIDEWAYS", "COMPRES=ZSTD"])
def test_options_that_gdal_refuses_are_an_error_in_one_line(deglint, sea, write, tmp_path, option):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", *RUN, "--co", option)
    assert ran.code == 1
    assert ran.err.count("\n") == 1
    assert "cannot write" in ran.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif"]


@pytest.mark.parametrize(
    "option", ["NODATA=0", "count=2", "TRANSFORM=1", "SHARING=1", "MODE=r", "PROFILE=BASELINE", "TFW=YES"]
)
def test_options_that_change_what_pixels_mean_or_leave_files_are_refused(deglint, sea, write, tmp_path, option):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", *RUN, "--co", option)
    assert (ran.code, ran.err.count("\n")) == (1, 1)
    assert f"{option.partition('=')[0]} is not for --co. Leave it out." in ran.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif"]


def test_a_sparse_file_may_lack_its_empty_blocks(deglint, sea, write, read, tmp_path):
    raw = sea(80, 130)
    raw[:, :, 64:] = 0
    source = write(tmp_path / "in.tif", raw, nodata=0, tiled=True, blockxsize=64, blockysize=64)
    assert deglint("remove", source, tmp_path / "out.tif", *RUN, "--co", "SPARSE_OK=TRUE").code == 0
    np.testing.assert_array_equal(read(tmp_path / "out.tif") == 0, raw == 0)


def test_the_amount_is_before_less_after(sea, write, read, tmp_path):
    raw = sea(dtype="float32")
    raw[0, 3, 3] = np.nan
    recipe = Recipe(method="hedley", sample="all", mask="0,0,50,80")
    remove_glint(write(tmp_path / "in.tif", raw), tmp_path / "out.tif", recipe, amount=tmp_path / "amount.tif")
    out, amount = read(tmp_path / "out.tif"), read(tmp_path / "amount.tif")
    np.testing.assert_array_equal(amount, raw[:3] - out[:3])
    assert not amount[:, :, 50:].any()
    with rasterio.open(tmp_path / "amount.tif") as dataset:
        assert dataset.dtypes == ("float32",) * 3
        assert dataset.descriptions == ("sun glint in blue", "sun glint in green", "sun glint in red")
        assert np.isnan(dataset.nodata)


PICTURES = {
    "usual": {},
    "one band corrected": {"bands": (1,)},
    "constant": {"constant": True},
    "NaN": {"holes": 0.5},
    "a band all NaN": {"empty_band": True},
    "one row": {"size": (1, 900)},
    "one column": {"size": (900, 1)},
    "larger than the picture": {"size": (70, 2000)},
}


@pytest.mark.parametrize("case", PICTURES.values(), ids=PICTURES.keys())
def test_a_picture_can_be_looked_at(sea, write, tmp_path, case):
    raw = sea(*case.get("size", (80, 100)), dtype="float32")
    if case.get("constant"):
        raw[:3] = 5
    if case.get("holes"):
        raw[:, np.random.default_rng(0).random(raw.shape[1:]) < case["holes"]] = np.nan
    if case.get("empty_band"):
        raw[1] = np.nan
    source = write(tmp_path / "in.tif", raw)
    model = library.fit("hedley", sea(dtype="float32"), nir=3, bands=library.open_scene(source).bands,
                        correct=case.get("bands", (0, 1, 2)))  # fmt: skip
    remove_glint(source, tmp_path / "out.tif", Recipe(mask="none"), model=model, picture=tmp_path / "look.png")
    picture = cv2.imread(str(tmp_path / "look.png"))
    assert picture is not None
    height, width = picture.shape[:2]
    assert 27 <= height <= 1000
    assert 400 <= width <= 2000
    assert (tmp_path / "look.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_the_picture_shows_less_glint_after(sea, write, tmp_path):
    remove_glint(write(tmp_path / "in.tif", sea(200, 400)), tmp_path / "out.tif", PLAIN, picture=tmp_path / "p.png")
    picture = cv2.imread(str(tmp_path / "p.png")).astype(float)
    middle = picture.shape[1] // 2
    before, after = (part.std(axis=(0, 1)) for part in (picture[30:, : middle - 4], picture[30:, middle + 4 :]))
    assert (before > 1.5 * after).all()


def test_the_sidecar_says_everything(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    ran = deglint("remove", source, tmp_path / "out.tif", "--mask", "none")
    assert ran.code == 0
    text = (tmp_path / "out.tif.json").read_text()
    said = json.loads(text, parse_constant=lambda c: pytest.fail(f"{c} is not JSON"))
    assert said["deglint"] == library.__version__
    assert set(said["versions"]) == {"python", "numpy", "rasterio", "gdal"}
    data = (tmp_path / "in.tif").read_bytes()
    assert said["input"] == [{"path": source, "bytes": len(data), "crc32": f"{zlib.crc32(data):08x}"}]
    assert "auto" not in (said["recipe"]["method"], said["recipe"]["regression"], said["recipe"]["nir_use"])
    assert [f["name"] for f in said["model"]["fits"]] == ["blue", "green", "red"]
    for fit in said["model"]["fits"]:
        assert fit["stderr"] > 0
        assert 0 < fit["r2"] <= 1
        assert fit["n"] > 0
    assert said["pixels"]["total"] == said["pixels"]["corrected"] == 8000
    assert said["skipped"]["water mask"].startswith("not searched for")
    assert said["skipped"]["nir"] == "glint reference: copied"
    assert said["warnings"] == []
    assert 5000 < said["model"]["fits"][0]["n"] < said["sample"]["pixels"] == 8000  # all that is not far out


def test_losses_are_warned_of(deglint, sea, write, tmp_path):
    raw = sea()
    raw[2] = 5
    ran = deglint(
        "remove", write(tmp_path / "in.tif", raw), tmp_path / "out.tif", *RUN, "--model", model_of(sea, tmp_path)
    )
    assert ran.code == 2  # a model and a method exclude each other
    ran = deglint(
        "remove", tmp_path / "in.tif", tmp_path / "out.tif", "--mask", "none", "--model", model_of(sea, tmp_path)
    )
    assert ran.code == 0
    assert "warning: pixels below zero after correction" in ran.err
    assert "clipped to the integer range" in ran.err


def model_of(sea, tmp_path):
    bands = [library.Band(n) for n in ("blue", "green", "red", "nir")]
    model = library.fit("hedley", sea(dtype="float32"), nir=3, bands=bands)
    (tmp_path / "model.json").write_text(model.to_json())
    return tmp_path / "model.json"


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_the_umask_is_respected(sea, write, tmp_path, umask, mode):
    source = write(tmp_path / "in.tif", sea())
    before = os.umask(umask)
    try:
        remove_glint(source, tmp_path / "out.tif", PLAIN, picture=tmp_path / "p.png")
    finally:
        os.umask(before)
    for name in ("out.tif", "out.tif.json", "p.png"):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == mode


def test_an_old_files_mode_is_kept_and_its_companions_go(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    out = tmp_path / "out.tif"
    out.write_text("old")
    out.chmod(0o640)
    for ending in (".aux.xml", ".ovr", ".msk"):
        (tmp_path / f"out.tif{ending}").write_text("of the old file")
    remove_glint(source, out, PLAIN, overwrite=True)
    assert stat.S_IMODE(out.stat().st_mode) == 0o640
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif", "out.tif.json"]


@pytest.mark.parametrize("ending", [".aux.xml", ".ovr", ".msk"])
def test_companions_without_their_image_are_not_deleted_unasked(sea, write, tmp_path, ending):
    beside = tmp_path / f"out.tif{ending}"
    beside.write_text("of somebody")
    with pytest.raises(WriteError, match=rf"out\.tif\{ending} exists already.*--overwrite"):
        remove_glint(write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", PLAIN)
    assert beside.read_text() == "of somebody"


def test_a_symbolic_link_is_written_through(sea, write, read, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "real.tif").write_text("old")
    (tmp_path / "out.tif").symlink_to(tmp_path / "there" / "real.tif")
    remove_glint(write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", PLAIN, overwrite=True)
    assert (tmp_path / "out.tif").is_symlink()
    assert read(tmp_path / "there" / "real.tif").shape == (4, 80, 100)
