"""ROC figures: against scikit-learn, brute force over all pairs, published tables, and simulation of the intervals."""

import json
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.ndimage import gaussian_filter
from scipy.ndimage import label as scipy_label
from sklearn import metrics

from deglint.errors import InputError
from detect.roc import Roc, auc_interval, bootstrap, compare, false_alarms, number_objects, object_curve
from detect.roc.bootstrap import default_block

from .common import SHARED, beside

CASES = st.tuples(
    st.lists(st.integers(-4, 6), min_size=1, max_size=25), st.lists(st.integers(-6, 4), min_size=1, max_size=60)
).filter(lambda c: len(set(c[0]) | set(c[1])) > 1)


def of(targets, background, dtype=np.float32):
    scores = np.array([*targets, *background], dtype)
    truth = np.arange(len(scores)) < len(targets)
    return scores, truth


def psi(target, background):
    return Fraction(int(target > background) * 2 + int(target == background), 2)


def test_pixels_that_a_masked_array_hides_are_left_out():
    scores = np.random.default_rng(0).normal(size=(40, 40))
    truth = np.zeros((40, 40), int)
    truth[20:24, 20:24], truth[30:34, 30:34] = 1, 2
    hidden = np.zeros((40, 40), bool)
    hidden[:21] = True
    masked, holed = np.ma.array(np.where(hidden, 99.0, scores), mask=hidden), np.where(hidden, np.nan, scores)
    assert Roc.of(masked, truth).auc == Roc.of(scores, np.ma.array(truth, mask=hidden)).auc == Roc.of(holed, truth).auc
    assert bootstrap(masked, truth, draws=10).auc == bootstrap(holed, truth, draws=10).auc
    assert compare(masked, scores, truth).difference == 0
    assert len(false_alarms(masked, truth, 2.0)) == len(false_alarms(holed, truth, 2.0))
    one, two = (object_curve(s, truth, Roc.of(s, truth)) for s in (masked, holed))
    assert one.objects == two.objects
    np.testing.assert_array_equal(one.false_alarms, two.false_alarms)


@given(CASES)
def test_area_and_its_variance_are_those_of_all_pairs(case):
    """Mann-Whitney and DeLong's components by definition, in exact fractions."""
    targets, background = case
    roc = Roc.of(*of(targets, background))
    v10 = [sum(psi(t, b) for b in background) / len(background) for t in targets]
    v01 = [sum(psi(t, b) for t in targets) / len(targets) for b in background]
    auc = sum(v10) / len(v10)
    assert roc.auc == pytest.approx(float(auc), abs=1e-15)
    found = auc_interval(roc)
    if len(targets) < 2 or len(background) < 2:
        assert np.isnan(found.standard_error)
        return
    variance = sum(sum((v - auc) ** 2 for v in part) / (len(part) - 1) / len(part) for part in (v10, v01))
    assert found.standard_error == pytest.approx(float(variance) ** 0.5, abs=1e-12)


@pytest.mark.slow
@given(CASES, st.sampled_from([0.01, 0.1, 0.37, 0.5, 0.999]))
def test_figures_agree_with_sklearn(case, pfa):
    scores, truth = of(*case)
    roc = Roc.of(scores, truth)
    assert roc.auc == pytest.approx(metrics.roc_auc_score(truth, scores), abs=1e-12)
    assert roc.mcclish(pfa) == pytest.approx(metrics.roc_auc_score(truth, scores, max_fpr=pfa), abs=1e-12)
    assert roc.average_precision == pytest.approx(metrics.average_precision_score(truth, scores), abs=1e-12)
    fpr, tpr, _ = metrics.roc_curve(truth, scores, drop_intermediate=False)
    pfas, pds = roc.vertices
    corners = set(zip(fpr.round(12), tpr.round(12), strict=True))
    assert set(zip(pfas.round(12), pds.round(12), strict=True)) <= corners  # and the areas under them are the same
    assert (np.diff(pfas) >= 0).all()
    assert (np.diff(pds) >= 0).all()
    point = roc.point(pfa)
    assert point.pd == tpr[fpr <= pfa * (1 + 1e-12)].max()
    assert point.pfa == (scores[~truth] > point.threshold).mean() <= pfa * (1 + 1e-12)
    assert point.pd == (scores[truth] > point.threshold).mean()
    precision, recall = roc.precision_recall
    p, r, _ = metrics.precision_recall_curve(truth, scores)
    assert set(zip(recall.round(12), precision.round(12), strict=True)) <= set(
        zip(r.round(12), p.round(12), strict=True)
    )


@given(CASES)
def test_partial_area_over_everything_is_the_area(case):
    roc = Roc.of(*of(*case))
    assert roc.partial_auc(1.0) == pytest.approx(roc.auc, abs=1e-12)
    assert roc.partial_auc(0.3) <= 0.3 + 1e-12


@given(CASES)
def test_three_d_measures_are_those_of_the_curves(case):
    """Areas over tau by summing the step curves, and by the trapezoid rule, at every distinct score."""
    scores, truth = of(*case, np.float64)
    tau = (scores - scores.min()) / np.ptp(scores)
    at = np.unique(tau)
    found = Roc.of(scores, truth).three_d()
    for key, part in (("d_tau", tau[truth]), ("f_tau", tau[~truth])):
        curve = np.array([(part >= t).mean() for t in at])
        assert found[key] == pytest.approx((curve[1:] * np.diff(at)).sum(), abs=1e-12)
        assert found[f"{key}_trapezoid"] == pytest.approx(trapezoid(curve, at), abs=1e-12)


@given(CASES, st.sampled_from([np.int16, np.uint8, np.float32, np.float64]))
def test_any_type_and_any_rising_map_gives_the_same_curve(case, dtype):
    scores, truth = of(*case, np.int16)
    first, second = Roc.of(scores, truth), Roc.of((scores + 10).astype(dtype), truth)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    cubed = Roc.of(scores.astype(np.float64) ** 3, truth)
    assert (cubed.auc, cubed.average_precision) == (first.auc, first.average_precision)
    assert Roc.of(-scores, truth).auc == pytest.approx(1 - first.auc)


def test_hanley_mcneil_1982():
    """Table I of doi:10.1148/radiology.143.1.7063747: area .893; Stata's roctab gives .8932, .0307, .83295, .95339."""
    normal, abnormal = [33, 6, 6, 11, 2], [3, 2, 2, 11, 33]
    ratings = np.concatenate([np.repeat(np.arange(1, 6), n) for n in (abnormal, normal)])
    found = auc_interval(Roc.of(ratings, np.arange(109) < 51))
    assert round(found.auc, 4) == 0.8932
    assert round(found.standard_error, 4) == 0.0307
    assert (round(found.low, 5), round(found.high, 5)) == (0.83295, 0.95339)


@given(CASES, st.randoms(use_true_random=False))
def test_paired_test_is_that_of_all_pairs(case, random):
    targets, background = case
    if len(targets) < 2 or len(background) < 2:
        return
    first, truth = of(targets, background)
    second = first + np.array([random.randint(-3, 3) for _ in first], np.float32)
    if len(set(second)) < 2:
        return
    parts = []
    for scores in (first, second):
        pairs = np.array([[float(psi(t, b)) for b in scores[~truth]] for t in scores[truth]])
        parts.append((pairs.mean(axis=1), pairs.mean(axis=0)))
    covariance = sum(np.cov(np.stack([a, b])) / len(a) for a, b in zip(*parts, strict=True))
    expected = np.sqrt(max(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1], 0))
    found = compare(first, second, truth)
    assert found.standard_error == pytest.approx(expected, abs=1e-7)
    assert found.difference == pytest.approx(Roc.of(first, truth).auc - Roc.of(second, truth).auc, abs=1e-12)
    if found.standard_error > 1e-6:
        assert found.z == pytest.approx(found.difference / found.standard_error)


def test_paired_test_of_the_same_scores_finds_nothing():
    scores, truth = of([3, 5, 1], [2, 0, 1, 4])
    found = compare(scores, scores * 2, truth)
    assert (found.difference, found.standard_error, found.p) == (0, 0, 1)


def test_paired_test_counts_what_is_valid_in_both():
    scores, truth = of([3, 5, 1], [2, 0, 1, 4])
    other = scores.copy()
    other[0] = np.nan
    assert compare(scores, other, truth).pixels == 6


def test_what_is_not_valid_is_left_out_and_counted():
    rng = np.random.default_rng(0)
    scores = rng.normal(size=(30, 40)).astype(np.float32)
    truth = (rng.random((30, 40)) < 0.2).astype(np.float32)
    keep = rng.random((30, 40)) < 0.7
    clean = Roc.of(scores[keep], truth[keep])
    for how in ("scores", "truth", "valid"):
        s, t = scores.copy(), truth.copy()
        if how == "scores":
            s[~keep] = np.nan
        if how == "truth":
            t[~keep] = np.nan
        roc = Roc.of(s, t, keep if how == "valid" else None)
        assert roc.left_out == (~keep).sum()
        np.testing.assert_array_equal(roc.background, clean.background)
        assert (roc.auc, roc.three_d()) == (clean.auc, clean.three_d())


@pytest.mark.parametrize(
    ("scores", "truth", "said"),
    [
        ([1.0, 2], [0, 0], "got 0 and 2 valid pixels"),
        ([1.0, 2], [1, 1], "got 2 and 0 valid pixels"),
        ([1.0, 1], [0, 1], "all 2 scores are 1: they distinguish nothing"),
        ([np.nan, np.nan], [0, 1], r"got 0 and 0 valid pixels \(2 left out"),
        ([1.0, np.nan], [0, 1], r"got 0 and 1 valid pixels \(1 left out"),
        ([1.0, np.inf], [0, 1], "infinity"),
        ([1.0, 2, 3], [0, 1], "one shape"),
        ([], [], "got 0 and 0 valid pixels"),
    ],
)
def test_refusals_are_one_line(scores, truth, said):
    with pytest.raises(InputError, match=said) as caught:
        Roc.of(np.array(scores), np.array(truth))
    assert "\n" not in str(caught.value)


def test_options_out_of_range():
    roc = Roc.of(*of([3], [1, 2]))
    for bad in (0, -1, 1.1, float("nan")):
        with pytest.raises(InputError, match="Pfa: allowed"):
            roc.point(bad)
        with pytest.raises(InputError, match="Pfa: allowed"):
            roc.partial_auc(bad)
    image, truth = np.arange(6.0).reshape(2, 3), np.eye(2, 3)
    for options, said in (({"draws": 1}, "draws"), ({"block": 0}, "block")):
        with pytest.raises(InputError, match=f"{said}: allowed"):
            bootstrap(image, truth, **options)
    with pytest.raises(InputError, match="must be"):
        bootstrap(np.arange(6.0), np.arange(6) > 4)


# ------------------------------------------------------------------------------------------------ objects


def test_objects_are_numbered_by_the_truth_or_by_connection():
    numbered = np.array([[0, 7, 7, 0], [0, 0, 0, 300]])
    np.testing.assert_array_equal(number_objects(numbered), numbered)
    binary = (numbered > 0).astype(np.float32)
    binary[1, 0] = np.nan
    assert number_objects(binary).max() == 1  # they touch at a corner
    assert number_objects(np.zeros((2, 2))).max() == 0
    classes = np.array([[1, 0, 1, 2], [0, 0, 0, 2]])
    np.testing.assert_array_equal(number_objects(classes), classes)
    np.testing.assert_array_equal(number_objects(classes, connected=True), [[1, 0, 2, 2], [0, 0, 0, 2]])
    with pytest.raises(InputError, match="allowed are 0 and integers"):
        number_objects(np.array([[0.5, 1.0]]))


@pytest.mark.parametrize("kind", ["uint32", "int64", "float64"])
def test_numbers_beyond_32_bits_do_not_merge_objects(kind):
    truth = np.array([[0, 3_000_000_001, 0, 3_000_000_007]], kind)
    with pytest.raises(InputError, match=r"2147483647.*objects.*3000000001"):
        number_objects(truth)
    np.testing.assert_array_equal(number_objects(truth, connected=True), [[0, 1, 0, 2]])


def brute_false_alarms(mask, objects):
    labels, count = scipy_label(mask, np.ones((3, 3)))
    return sum(not (objects[labels == i] != 0).any() for i in range(1, count + 1))


def test_object_curve_is_that_of_brute_force():
    rng = np.random.default_rng(3)
    scores = gaussian_filter(rng.normal(size=(60, 70)), 1).astype(np.float32)
    truth = np.zeros((60, 70), int)
    for i in range(9):
        r, c = rng.integers(0, 56, 2)
        truth[r : r + 3, c : c + 4] = i + 1
        scores[r : r + 3, c : c + 4] += 0.15 * i
    scores[59] = scores[5:9, 5:9] = np.nan
    scores[tuple(np.argwhere(truth == 3)[0])] = np.nan
    truth[59, 6] = 20  # an object without a valid pixel
    roc = Roc.of(scores, truth)
    curve = object_curve(scores, truth, roc, pfa_max=0.2)
    assert curve.unseen == (20,)
    assert {o.number for o in curve.objects} == set(np.unique(truth)) - {0, 20}
    for o in curve.objects:
        own = scores[truth == o.number]
        assert (o.size, o.left_out) == (np.isfinite(own).sum(), np.isnan(own).sum())
        assert o.score_max == np.nanmax(own)
        assert o.pfa == (scores[truth == 0] >= o.score_max).sum() / len(roc.background)
    assert (np.diff(curve.thresholds) < 0).all()
    for i, t in enumerate(curve.thresholds):
        mask = scores >= t
        assert curve.found[i] == len(set(np.unique(truth[mask])) - {0})
        assert curve.false_alarms[i] == brute_false_alarms(mask, truth)
        assert curve.pfa[i] == pytest.approx((mask & (truth == 0)).sum() / len(roc.background))
    assert curve.pd[-1] == curve.found[-1] / len(curve.objects)
    threshold = roc.point(0.05).threshold
    alarms = false_alarms(scores, truth, threshold)
    assert len(alarms) == brute_false_alarms(scores > threshold, truth)
    assert alarms[0].score_max == max(a.score_max for a in alarms)


# ------------------------------------------------------------------------------------------------ bootstrap


def correlated(rng, side=96, objects=12):
    """Clutter correlated over some pixels, and objects that each have a contrast of their own."""
    scores = gaussian_filter(rng.normal(size=(side, side)), 2, mode="wrap") * 7
    truth = np.zeros((side, side), int)
    for i in range(objects):
        r, c = 8 + 24 * (i // 4), 8 + 24 * (i % 4)
        truth[r : r + 5, c : c + 5] = i + 1
        scores[r : r + 5, c : c + 5] += rng.normal(1.2, 1.0)
    return scores.astype(np.float32), truth


def test_intervals_cover_what_they_should_and_delong_does_not():
    """The expected area over 300 scenes lies in about 95 % of the bootstrap's intervals, in few of DeLong's."""
    rng = np.random.default_rng(12)
    scenes = [correlated(rng) for _ in range(300)]
    truth = np.mean([Roc.of(*scene).auc for scene in scenes])
    drawn = naive = 0
    for scores, objects in scenes[:100]:
        low, high = bootstrap(scores, objects, draws=120, seed=1, pfa=[0.1]).auc
        drawn += low <= truth <= high
        one = auc_interval(Roc.of(scores, objects))
        naive += one.low <= truth <= one.high
    assert 0.87 <= drawn / 100 <= 0.99
    assert naive / 100 < 0.6


def test_a_draw_of_everything_is_the_curve_itself():
    """Every piece drawn once: the area and Pd of the counts are those of the pixels, ties and all."""
    from detect.roc.bootstrap import _count, _draw, _levels

    rng = np.random.default_rng(5)
    scores, objects = correlated(rng)
    scores = np.round(scores * 4) / 4
    roc = Roc.of(scores, objects)
    counts = _count(scores, objects, np.ones(scores.shape, bool), _levels(roc), 16)
    targets, background = (pieces.toarray() for pieces in counts)
    assert (targets.sum(), background.sum()) == (len(roc.targets), len(roc.background))
    at = np.array([1e-3, 1e-2, 0.1, 0.5, 1.0])
    areas, pds = _draw(targets.sum(axis=0, keepdims=True), background.sum(axis=0, keepdims=True), at, 3, 0)
    np.testing.assert_allclose(areas, roc.auc, rtol=1e-12)
    np.testing.assert_allclose(pds[0], [roc.point(p).pd for p in at], rtol=1e-12)


def test_bootstrap_is_the_same_for_the_same_seed_only():
    scores, objects = correlated(np.random.default_rng(1))
    a, b, c = (bootstrap(scores, objects, draws=150, seed=s) for s in (4, 4, 5))
    np.testing.assert_array_equal(a.low, b.low)
    assert a.auc == b.auc
    assert a.auc != c.auc
    assert (a.objects, a.blocks, a.block) == (12, 36, 16)
    assert (a.low <= a.high).all()
    assert a.auc[0] < Roc.of(scores, objects).auc < a.auc[1]


def test_few_pieces_are_said():
    scores, objects = correlated(np.random.default_rng(1))
    assert "few objects (1)" in bootstrap(scores, objects == 1, draws=20).notes[0]
    notes = bootstrap(scores, np.where(objects < 4, objects, 0), draws=20, block=96).notes
    assert "few objects (3)" in notes[0]
    assert "few blocks (1)" in notes[1]
    assert default_block(4096, 4096) == 171
    assert default_block(10, 10) == 16


# ------------------------------------------------------------------------------------------------ real scenes


def global_rx(cube):
    """Squared Mahalanobis distance to the scene's mean, full covariance, float64."""
    x = cube.reshape(-1, cube.shape[2]).astype(np.float64)
    x = x - x.mean(axis=0)
    return np.einsum("ij,ij->i", x, np.linalg.solve(x.T @ x / (len(x) - 1), x.T).T).reshape(cube.shape[:2])


@beside("hyperspectral")
@pytest.mark.parametrize("name", ["abu-beach-1", "abu-beach-2", "abu-airport-2", "abu-urban-1"])
def test_every_figure_of_the_labelled_scenes(name):
    from scipy.io import loadmat

    golden = json.loads((SHARED / "hyperspectral" / "golden_rx.json").read_text())[name]
    scene = loadmat(SHARED / "hyperspectral" / f"{name}.mat")
    scores, truth = global_rx(scene["data"]), scene["map"]
    roc = Roc.of(scores, truth)
    objects = number_objects(truth)
    curve = object_curve(scores, objects, roc)
    three = roc.three_d()
    limit = roc.point(1e-2).threshold
    figures = {
        "n_pos": len(roc.targets), "n_objects": len(curve.objects), "auc": roc.auc,
        "delong_auc": roc.auc, "delong_se": auc_interval(roc).standard_error,
        "pauc_raw_0p1": roc.partial_auc(0.1), "pauc_raw_0p01": roc.partial_auc(0.01),
        "pauc_mcclish_0p1": roc.mcclish(0.1), "pauc_mcclish_0p01": roc.mcclish(0.01),
        "pd_at_1e2": roc.point(1e-2).pd, "pd_at_1e3": roc.point(1e-3).pd,
        "object_pd_at_pfa_1e2": np.mean([o.score_max > limit for o in curve.objects]),
        "average_precision": roc.average_precision,
        "auc_D_tau_exact": three["d_tau"], "auc_F_tau_exact": three["f_tau"],
        "auc_D_tau_trapz": three["d_tau_trapezoid"], "auc_F_tau_trapz": three["f_tau_trapezoid"],
        "auc_TD": three["td"], "auc_BS": three["bs"], "auc_OD": three["od"], "auc_SNPR": three["snpr"],
    }  # fmt: skip
    for key, value in figures.items():
        assert value == pytest.approx(golden[key], abs=5e-7), key


def test_the_curve_is_drawn():
    pytest.importorskip("matplotlib").use("agg")
    roc = Roc.of(np.array([1.0, 2, 2, 3, 9]), np.array([0, 0, 1, 0, 1]))
    ax = roc.plot(label="rx")
    pfa, pd = ax.lines[0].get_data()
    np.testing.assert_array_equal((pfa, pd), roc.vertices)
    assert ax.get_legend().get_texts()[0].get_text() == "rx, AUC 0.7500"
    assert roc.plot(ax) is ax
