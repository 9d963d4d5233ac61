"""Values that cost digits or cannot be computed: offsets, extremes, constants, small samples, impossible requests."""

import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stress import sea
from deglint import remove
from deglint.errors import FitError
from deglint.moments import cell_moments
from deglint.remove.detrend import detrend
from detect.background import fit
from detect.global_rx import detector, rx, score
from detect.local import local_rx
from detect.roc import Roc, auc_interval, compare
from detect.threshold import from_f, p_value


def test_a_stray_first_pixel_of_a_cell_costs_the_mean_no_digits():
    block = sea(64, 64)
    block[3, 0, 0] = 1e15
    exact = sum(Fraction(float(v)) for v in block[3].ravel()) / 4096
    assert abs(Fraction(float(cell_moments(block).total().mean[3])) - exact) / exact < 1e-15


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_detrending_keeps_its_digits_under_an_offset(dtype):
    block = (sea(40, 40) * 64).astype(dtype)  # integers: the offset rounds nothing
    offset = dtype(2.0**23) if dtype is np.float32 else 1e8
    np.testing.assert_array_equal(detrend(block + offset, size=9), detrend(block, size=9))
    constant = np.full((1, 20, 20), 0.1, dtype)
    np.testing.assert_array_equal(detrend(constant, size=15), 0)


def test_standard_errors_between_cells_do_not_depend_on_an_offset():
    block = sea(256, 256)  # 16 cells
    plain, moved = (remove.fit("lyzenga", b, nir=3).fits[0].stderr for b in (block, block + 1e8))
    assert moved == pytest.approx(plain, rel=1e-12)


def test_a_percentile_of_float32_is_interpolated_in_double():
    nir = np.linspace(1, 2, 10_000).astype(np.float32).reshape(100, 100)
    found = remove.fit("hedley", np.stack([3 * nir, nir]), nir=1, floor_percentile=5).indexes[0].level
    assert found == pytest.approx(np.percentile(nir.astype(float), 5), rel=1e-15)


@pytest.mark.parametrize("regression", ["huber", "theil-sen", "ols", "detrended"])
def test_a_constant_band_has_no_slope_and_warns_of_nothing(regression):
    nir = sea(40, 40)[3]
    model = remove.fit("lyzenga", np.stack([np.full_like(nir, 0.1), nir]), nir=1, regression=regression)
    assert model.fits[0].slope == 0


@pytest.mark.parametrize("scale", [1e-315, 1e200])
def test_numbers_whose_squares_are_none_are_refused(scale):
    block = sea(20, 20)
    with np.errstate(under="ignore"):
        small = block * scale
    for band in range(4) if scale > 1 else [3]:
        hard = block.copy()
        hard[band] = small[band]
        with pytest.raises(FitError, match=f"band {band + 1}.*double precision.*--scale.*--nodata"):
            remove.fit("hedley", hard, nir=3)
        with pytest.raises(FitError, match=f"band {band + 1}.*double precision.*--scale.*--nodata"):
            fit(hard)


def test_scores_of_float64_keep_their_digits_under_an_offset():
    block = sea(60, 60)
    plain, moved = rx(block), rx(block + 1e8)
    np.testing.assert_allclose(moved, plain, rtol=1e-12, atol=1e-12)


def test_float16_is_scored():
    block = np.rint(sea(30, 30)).astype(np.float16)
    ready = detector("rx", fit(block))
    expected = rx(block.astype(np.float32))
    np.testing.assert_allclose(score(block, ready), expected, rtol=1e-5)
    found = local_rx(block, inner=3, outer=9)
    np.testing.assert_allclose(found, local_rx(block.astype(np.float32), inner=3, outer=9), rtol=1e-5)


def test_nearly_equal_detectors_are_distinguished():
    background = np.arange(1_000_000)
    truth = np.arange(1_000_010) < 10
    first = np.concatenate([np.full(10, 2e6), background])
    second = first.copy()
    second[0] = 999_998.5  # below one pixel of the background
    both = compare(first, second, truth)
    assert both.difference == pytest.approx(1e-7, rel=1e-8)  # 1 of 1e7 pairs
    assert auc_interval(Roc.of(second, truth)).standard_error == pytest.approx(
        math.sqrt(1e-12 * 0.1 / 10 + 1e-2 * (1e-6 - 1e-12) / (1 - 1e-6) / 1e6), rel=1e-12
    )


@pytest.mark.parametrize(("bands", "n", "pfa"), [(8, 9, 1e-10), (8, 10, 1e-3), (200, 250, 1e-6), (3, 1000, 1e-4)])
def test_f_thresholds_and_p_values_of_small_samples(bands, n, pfa):
    mpmath = pytest.importorskip("mpmath")
    at = from_f(pfa, bands, n).value
    with mpmath.workdps(40):
        w = mpmath.mpf(at) * n / (mpmath.mpf(n) ** 2 - 1)
        tail = mpmath.betainc(mpmath.mpf(n - bands) / 2, mpmath.mpf(bands) / 2, 0, 1 / (1 + w), regularized=True)
    assert float(tail) == pytest.approx(pfa, rel=1e-12)
    assert float(p_value(np.array(at), bands, n)) == pytest.approx(float(tail), rel=1e-12)


@pytest.mark.parametrize(("dtype", "value"), [
    ("float32", -3.4028234663852886e38), ("float32", 3.4028230607370965e38), ("float64", -3.4028234663852886e38),
    ("float64", -1.7976931348623157e308),
])  # fmt: skip
def test_forgotten_nodata_is_not_valid(deglint, write, read, tmp_path, dtype, value):
    import json

    image = sea(80, 90).astype(dtype)
    holes = np.random.default_rng(5).random((80, 90)) < 0.01
    paths = {}
    for name, fill in (("said", np.nan), ("forgotten", value)):
        dirty = np.where(holes, np.asarray(fill, dtype), image)
        source, out = write(tmp_path / f"{name}.tif", dirty), tmp_path / f"{name}_out.tif"
        ran = deglint("remove", source, out, "--method", "hedley", "--compensate", "off", "--sample", "all", "--mask",
                      "none", "--json")  # fmt: skip
        assert ran.code == 0, ran.err
        assert "Warning" not in ran.err
        paths[name] = read(out), json.loads(ran.out)
    np.testing.assert_array_equal(paths["forgotten"][0][:, ~holes], paths["said"][0][:, ~holes])
    assert (paths["forgotten"][0][:, holes] == np.asarray(value, dtype)).all()  # passes as it is


@pytest.mark.parametrize("out", [".", "", "out.jpg", "out.nc"])
def test_outputs_without_a_name_or_with_that_of_another_format(deglint, sea, write, tmp_path, monkeypatch, out):
    from detect.cli import run

    monkeypatch.chdir(tmp_path)
    source = write(tmp_path / "in.tif", sea())
    ran = deglint("remove", source, out)
    assert (ran.code, ran.err.count("\n")) == (1, 1)
    assert "a bug in" not in ran.err
    assert run(["score", source, out]) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


@pytest.mark.parametrize(("arguments", "said"), [
    (["."], "no name for a scene"), (["out", "--size", "100000000"], "8 to 16384"), (["out", "--size", "1"], "8 to"),
])  # fmt: skip
def test_scenes_that_cannot_be_simulated_are_refused_at_once(deglint, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    ran = deglint("simulate", *arguments)
    assert ran.code in (1, 2)
    assert said in ran.err
    assert not list(tmp_path.iterdir())


def test_a_full_standard_output_is_one_line(sea, write, tmp_path):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    source = write(tmp_path / "in.tif", sea())
    with full.open("w") as out:
        done = subprocess.run(
            [sys.executable, "-m", "deglint", "info", source, "--json"], stdout=out, stderr=subprocess.PIPE, text=True,
            check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("Error: No space left on device")


def test_thresholds_beyond_float32_warn_of_nothing():
    from detect.threshold import Tail

    scores = np.array([1.0, 2.0, 3.4e38], np.float32)
    assert Tail.of(scores).above(1e99) == 0


@pytest.mark.parametrize(("number", "said"), [(1e200, r"1e\+200"), (2e15, r"2e\+15"), (-2e15, r"2e\+15")])
def test_numbers_whose_squares_exceed_float32_are_not_compensated(number, said):
    from deglint.compensate.state import State
    from deglint.errors import InputError

    with pytest.raises(InputError, match=f"reach {said}.*--scale"):
        State.of(np.full((1, 3, 3), number))
