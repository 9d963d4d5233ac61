"""Global detectors: recorded figures of labelled scenes, the spectral package, and the identities that RX holds."""

import json
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.errors import FitError, InputError
from detect import background, local_rx, rx
from detect.global_rx import DETECTORS, detector, residual_rx, rx_utd, score, subspace_rx, utd
from detect.sea.search import score_scene

from ..common import SHARED, beside, image_of

ABU = ("abu-beach-1", "abu-beach-2", "abu-airport-2", "abu-urban-1")


def longdouble_rx(image):
    """The definition, on the inverse of an exactly centred covariance."""
    x = image.reshape(len(image), -1).astype(np.longdouble)
    d = (x - x.mean(axis=1, keepdims=True)).astype(float)
    return (d * np.linalg.solve(d @ d.T / (d.shape[1] - 1), d)).sum(axis=0).reshape(image.shape[1:])


@beside("hyperspectral")
@pytest.mark.parametrize("name", ABU)
def test_the_recorded_areas_are_reproduced(name):
    from scipy.io import loadmat
    from sklearn.metrics import roc_auc_score

    golden = json.loads((SHARED / "hyperspectral" / "golden_rx.json").read_text())[name]
    scene = loadmat(SHARED / "hyperspectral" / golden["file"])
    image, truth = np.ascontiguousarray(scene["data"].transpose(2, 0, 1)), scene["map"].astype(bool)
    scores = rx(image.astype(np.float64))
    assert roc_auc_score(truth.ravel(), scores.ravel()) == pytest.approx(golden["auc"], abs=5e-7)
    assert scores.mean() == pytest.approx(golden["mean_score"], rel=1e-9)
    above = (scores > golden["chi2_thr_1e3"])[~truth].mean()
    assert above == pytest.approx(golden["empirical_pfa_at_chi2_1e3"], abs=1e-12)
    np.testing.assert_array_equal(rx(image), scores.astype(np.float32))


def test_as_the_spectral_package():
    import spectral

    image = image_of()
    theirs = spectral.rx(image.transpose(1, 2, 0))
    np.testing.assert_allclose(rx(image), theirs, rtol=1e-10)


def test_mean_score_is_known_exactly():
    image = image_of()
    n = 40 * 50
    assert rx(image).mean() == pytest.approx(5 * (n - 1) / n, rel=1e-13)


@given(seed=st.integers(0, 2**32 - 1), decades=st.floats(0, 6))
@settings(max_examples=25)
def test_no_invertible_map_of_the_bands_changes_it(seed, decades):
    rng = np.random.default_rng(seed)
    image = image_of(seed=seed)
    u, _ = np.linalg.qr(rng.normal(size=(5, 5)))
    matrix = u @ np.diag(10 ** rng.uniform(-decades / 2, decades / 2, 5))
    mapped = np.einsum("ij,jrc->irc", matrix, image) + rng.normal(size=(5, 1, 1)) * 100
    np.testing.assert_allclose(rx(mapped), rx(image), rtol=1e-4)


@pytest.mark.parametrize("factor", [1e-12, 1e-3, 1e9])
def test_units_do_not_matter(factor):
    image = image_of()
    image[2] *= 1e5
    for rule in background.COVARIANCES:
        expected = rx(image, covariance=rule)
        np.testing.assert_allclose(rx(image * factor, covariance=rule), expected, rtol=1e-9)


def test_order_of_bands_does_not_matter():
    image = image_of()
    np.testing.assert_allclose(rx(image[::-1]), rx(image), rtol=1e-11)


def test_a_linear_deglint_that_keeps_the_nir_does_not_change_it():
    from deglint import remove

    image = image_of() + 50
    model = remove.fit("hedley", image, nir=4, correct=range(4))
    clean = remove.apply(image, model)
    np.testing.assert_allclose(rx(clean), rx(image), rtol=1e-9)
    np.testing.assert_allclose(residual_rx(clean, nir=[4]), residual_rx(image, nir=[4]), rtol=1e-7)
    window = {"inner": 3, "outer": 11}
    np.testing.assert_allclose(local_rx(clean, **window), local_rx(image, **window), rtol=1e-8)


@pytest.mark.parametrize("offset", [1e6, 1e8])
def test_a_large_offset_costs_what_rounding_the_pixels_costs(offset):
    image = image_of()
    image = (image + offset).astype(np.float64)
    np.testing.assert_allclose(rx(image), longdouble_rx(image - offset), rtol=1e-9)


def test_large_float32_images_keep_their_digits():
    """float32 sums stall here: the mean score would be several times too large."""
    rng = np.random.default_rng(0)
    image = (1000 + rng.normal(size=(2, 1500, 1500))).astype(np.float32)
    n = 1500 * 1500
    assert rx(image).mean(dtype=np.float64) == pytest.approx(2 * (n - 1) / n, rel=1e-6)


def test_constant_band_is_as_if_dropped():
    image = image_of()
    more = np.insert(image, 2, 1e8 + 0.1, axis=0)
    np.testing.assert_allclose(rx(more), rx(image), rtol=1e-11)


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_collinear_bands_are_as_if_dropped(offset):
    image = image_of() + offset
    more = np.concatenate([image, image[:1] + image[1:2], 3 * image[2:3]])
    np.testing.assert_allclose(rx(more), rx(image), rtol=1e-8)


def test_fewer_pixels_than_bands():
    image = np.random.default_rng(0).normal(size=(30, 4, 5))
    scores = rx(image)
    np.testing.assert_allclose(scores, 19**2 / 20, rtol=1e-9)  # every pixel is a corner of the same simplex


def test_what_is_not_valid_is_as_if_removed():
    image = image_of().astype(np.float32)
    spoilt = image.copy()
    spoilt[1, :5] = np.nan
    spoilt[3, 5:8] = np.inf
    mask = np.ones((40, 50), bool)
    mask[8:10] = False
    spoilt[:, 8:10] = -9999
    scores = rx(spoilt, mask=mask)
    assert np.isnan(scores[:10]).all()
    np.testing.assert_allclose(scores[10:], rx(image[:, 10:]), rtol=2e-7)


def test_a_background_from_a_mask_and_from_another_scene():
    image, other = image_of(), image_of(seed=1)
    inside = np.zeros((40, 50), bool)
    inside[:20] = True
    np.testing.assert_allclose(rx(image, inside), rx(image, background.fit(image[:, :20])), rtol=1e-12)
    d = image.reshape(5, -1).T - other.reshape(5, -1).T.mean(axis=0)
    expected = (d @ np.linalg.inv(np.cov(other.reshape(5, -1))) * d).sum(axis=1).reshape(40, 50)
    np.testing.assert_allclose(rx(image, background.fit(other)), expected, rtol=1e-9)


def test_one_extreme_pixel_is_the_only_one_that_overflows():
    image = image_of().astype(np.float32)
    found = background.fit(image)
    image[:, 3, 4] = 3e38
    scores = rx(image, found)
    assert scores[3, 4] == np.finfo(np.float32).max
    rest = np.ones((40, 50), bool)
    rest[3, 4] = False
    np.testing.assert_array_equal(scores[rest], rx(image_of().astype(np.float32), found)[rest])


@pytest.mark.parametrize("method", [name for name, kind in DETECTORS.items() if kind.matrices])
@pytest.mark.parametrize("bands", [1, 2, 5, 40])
@given(top=st.integers(0, 60), left=st.integers(0, 60), rows=st.integers(1, 80), columns=st.integers(1, 80))
@settings(max_examples=4)
def test_blocks_score_as_the_whole_to_the_bit(method, bands, top, left, rows, columns):
    if bands == 1 and method in ("subspace", "residual"):
        return
    image = image_of(bands=bands, rows=130, columns=140).astype(np.float32)
    found = detector(method, background.fit(image), nir=[bands - 1])
    at = (slice(None), slice(top, top + rows), slice(left, left + columns))
    np.testing.assert_array_equal(score(image[at], found), score(image, found)[at[1:]])


def test_utd_and_rx_utd_are_their_definitions():
    image = image_of()
    x = image.reshape(5, -1)
    mean, inverse = x.mean(axis=1, keepdims=True), np.linalg.inv(np.cov(x))
    like = ((1 - mean).T @ inverse @ (x - mean)).reshape(40, 50)
    less = ((x - 1) * (inverse @ (x - mean))).sum(axis=0).reshape(40, 50)
    np.testing.assert_allclose(utd(image), like, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rx_utd(image), less, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rx(image) - utd(image), rx_utd(image), rtol=1e-9, atol=1e-9)


def test_subspace_leaves_the_leading_eigenvectors_out():
    image = image_of()
    x = image.reshape(5, -1)
    values, vectors = np.linalg.eigh(np.cov(x))
    principal = (vectors.T @ (x - x.mean(axis=1, keepdims=True))) ** 2 / values[:, None]
    np.testing.assert_allclose(subspace_rx(image, drop=2), principal[:3].sum(axis=0).reshape(40, 50), rtol=1e-9)
    np.testing.assert_allclose(subspace_rx(image, drop=0), rx(image), rtol=1e-9)
    with pytest.raises(InputError, match="drop: want 0 to 4"):
        subspace_rx(image, drop=5)


@pytest.mark.parametrize(
    ("function", "options"),
    [
        (rx, {}),
        (utd, {}),
        (rx_utd, {}),
        (subspace_rx, {}),
        (residual_rx, {"nir": [2]}),
        (local_rx, {"inner": 3, "outer": 11}),
        (lambda image: background.fit(image).covariance, {}),
        (lambda image: score_scene(image).scores, {}),
    ],
    ids=["rx", "utd", "rx_utd", "subspace_rx", "residual_rx", "local_rx", "fit", "score_scene"],
)
def test_pixels_of_a_masked_array_are_not_valid(function, options):
    image = image_of()
    holed = image.copy()
    image[1, 5:9, 5:9] = -9999
    holed[:, 5:9, 5:9] = np.nan
    np.testing.assert_array_equal(function(np.ma.masked_equal(image, -9999), **options), function(holed, **options))


@pytest.mark.parametrize(("function", "options"), [(rx, {}), (local_rx, {"inner": 3, "outer": 11})])
def test_the_byte_order_of_an_image_changes_nothing(function, options):
    image = image_of()
    found = function(image.astype(">f8"), **options)
    np.testing.assert_array_equal(found, function(image, **options))
    assert found.dtype == np.float64


@pytest.mark.parametrize("function", [rx, background.fit, score_scene])
@pytest.mark.parametrize("shape", [(3, 0, 50), (3, 50, 0), (0, 5, 5)])
def test_an_empty_image_is_refused(function, shape):
    with pytest.raises(InputError, match="at least one value"):
        function(np.zeros(shape))


def test_residual_is_rx_less_that_of_the_reference():
    image = image_of()
    np.testing.assert_allclose(residual_rx(image, nir=[3, 4]), rx(image) - rx(image[3:]), rtol=1e-8, atol=1e-8)
    rest = image[:3] - np.einsum("i,rc->irc", *_regressed(image[:3], image[4]))
    np.testing.assert_allclose(residual_rx(image[[0, 1, 2, 4]], nir=[3]), rx(rest), rtol=1e-9)
    twice = np.concatenate([image, 2 * image[4:]])  # a band that the reference explains wholly
    np.testing.assert_allclose(residual_rx(twice, nir=[4]), residual_rx(image, nir=[4]), rtol=1e-7)
    for wrong in ([], [5], [-1], [0, 1, 2, 3, 4]):
        with pytest.raises(InputError, match="nir: want some of the bands"):
            residual_rx(image, nir=wrong)


def _regressed(bands, nir):
    centred = nir - nir.mean()
    return (bands * centred).sum(axis=(1, 2)) / (centred**2).sum(), centred


def test_wrong_bands_methods_and_threads_are_refused():
    with pytest.raises(FitError, match="no band of the background varies"):
        rx(np.ones((3, 4, 4)))
    with pytest.raises(InputError, match="not one of rx, utd"):
        detector("nonsense", background.fit(image_of()))
    with pytest.raises(InputError, match=r"image .*3 bands.*background 5"):
        rx(image_of()[:3], background.fit(image_of()))
    for function in (rx, background.fit, partial(local_rx, inner=3, outer=11)):
        with pytest.raises(InputError, match=r"^threads: .*1 to 1024.* -1\b"):
            function(image_of(), threads=-1)


def test_inputs_are_not_modified():
    image = image_of()
    image.flags.writeable = False
    rx(image, np.ones((40, 50), bool), mask=np.ones((40, 50), bool))
