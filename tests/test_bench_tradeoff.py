"""Experiments on run time against error and on skipping: their parts on numbers known beforehand, and quick runs."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from detect.bench import copying, skipping, tolerance, tradeoff, tradeoff_measure
from detect.bench.front import dominated, front
from detect.bench.section import Effort, Section
from detect.bench.tradeoff_parts import MEDIANS, Parts, medians, samples
from detect.report.scatter import scatter
from detect.report.svg import Axis

points = st.dictionaries(
    st.text("abcdef", min_size=1, max_size=3),
    st.tuples(st.floats(0.1, 100), st.floats(0.1, 100)),
    min_size=1,
    max_size=12,
)


@given(points)
def test_front_against_brute_force(found):
    kept = front(found)
    for name, (x, y) in found.items():
        beaten = any(a <= x and b <= y and (a, b) != (x, y) for a, b in found.values())
        if name in kept:
            assert not beaten
        else:
            assert beaten or any(found[k] == (x, y) for k in kept)
    exact = dominated(found, (1.0, 1.0))
    assert not set(exact) & set(kept)
    for name, by in exact.items():
        assert all(p <= q for p, q in zip(found[by], found[name], strict=True))
    assert set(dominated(found)) <= set(exact)


def made(quick_found):
    """What a quick run would have found, without running it."""
    found = tradeoff_measure.Found(["9 m/s, 0 ms", "9 m/s, 60 ms"], raw=[200.0, 300.0], noise=[3.0, 3.0])
    for name, (rms, loss, fit, apply) in quick_found.items():
        found.rms[name], found.deep[name] = [rms, 2 * rms], [rms, rms]
        found.loss[name], found.fit[name], found.apply[name] = [loss, loss], [fit, fit], [apply, apply]
    return found


FOUND = {
    "joyce/ols/off": (50.0, 0.1, 10.0, 3.0),
    "joyce/huber/off": (52.0, 0.1, 300.0, 3.0),
    "multiband/psf0": (6.0, 0.002, 100.0, 60.0),
    "multiband/psf2": (5.0, 0.001, 300.0, 90.0),
    "auto": (5.0, 0.001, 310.0, 90.0),
    "auto, sample found": (5.1, 0.001, 600.0, 90.0),
}


def test_the_words_are_of_the_numbers():
    found = made(FOUND)
    error = tradeoff.by_error(found)
    assert error["auto"] == pytest.approx((400.0, 5 * np.sqrt(2)))
    assert front(error) == ["joyce/ols/off", "multiband/psf0", "multiband/psf2"]
    assert dominated(error) == {"joyce/huber/off": "multiband/psf0", "auto, sample found": "auto"}
    assert tradeoff.distance(error) == pytest.approx((1.0, 400 / 390))
    said = " ".join(tradeoff._said(found, error, tradeoff.by_loss(found)))
    assert "No choice is both quicker than --method auto and leaves less" in said
    found = made(FOUND | {"auto": (9.0, 0.001, 310.0, 90.0)})
    error = tradeoff.by_error(found)
    assert "--method auto is beaten by multiband/psf2" in tradeoff._said(found, error, tradeoff.by_loss(found))[1]


def test_what_cannot_be_fitted_is_left_out_and_said():
    found = made(FOUND)
    found.rms["kutser/off"] = [float("nan"), 1.0]
    assert "kutser/off" not in tradeoff.by_error(found)
    table = tradeoff._table(found, tradeoff.by_error(found), tradeoff.by_loss(found))
    assert "Not for these bands: kutser/off" in table.note
    assert not any("kutser" in name for name in tradeoff_measure.numbers(found))


@pytest.mark.parametrize("name", list(MEDIANS))
def test_medians(name):
    values = np.random.default_rng(1).normal(10, 1, 100_001).astype(np.float32)
    most = 0.0 if "exact" in name else 0.3
    assert abs(MEDIANS[name](values) - float(np.median(values))) <= most
    assert MEDIANS[name](np.full(1000, 3.0, np.float32)) == 3.0


def test_labels_of_a_scatter_lie_inside_and_apart():
    found = {f"choice number {i}": (10.0 + i, 10.0 + i % 3) for i in range(20)} | {"<&>": (11.0, 11.0)}
    x, y = Axis("x", 1, 100, log=True), Axis("y", 1, 100, log=True)
    drawn = scatter(found, x, y, title="a < b", line=list(found)[:3], named=list(found), marked=("<&>",))
    assert "<&>" not in drawn
    assert "a &lt; b" in drawn
    texts = re.findall(r'<text x="([\d.]+)" y="([\d.]+)" font-size="12">(choice[^<]*)<', drawn)
    boxes = [(float(left), float(base), float(left) + 6.4 * len(name), float(base) - 14) for left, base, name in texts]
    assert len(boxes) > 5
    for i, a in enumerate(boxes):
        assert a[0] >= 62
        assert a[2] <= 960
        assert not any(a[0] < b[2] and b[0] < a[2] and a[3] < b[1] and b[3] < a[1] for b in boxes[:i])


@pytest.fixture
def effort(tmp_path):
    return Effort(quick=True, seeds=1, directory=tmp_path, threads=1)


def check(section: Section, effort, prefix):
    numbers = section.every_number()
    assert numbers
    assert all(name.startswith(prefix) for name in numbers)
    assert all(np.isfinite(n.value) for n in numbers.values())
    assert not list(effort.directory.iterdir())
    for part in (section, *section.parts):
        for table in part.tables:
            assert all(len(row) == len(table.head) for row in table.rows)
    return numbers


def test_tradeoff_of_a_few_choices(effort, monkeypatch):
    """Every road through the measurement, on two choices and small scenes."""
    few = [c for c in tradeoff_measure.choices(True) if c.name in ("joyce/ols/off", "kutser/off", "multiband/psf0")]
    few += [tradeoff_measure.Choice(tradeoff_measure.AUTO, {"compensate": "off"})]
    monkeypatch.setattr(tradeoff_measure, "choices", lambda quick: few)
    parts = Parts()
    found = tradeoff_measure.measure(effort, parts.add)
    assert found.conditions == ["9 m/s, 0 ms", "9 m/s, 60 ms"]
    assert found.rms["multiband/psf0"][1] < 0.2 * found.raw[1]
    assert all(n < r for n, r in zip(found.noise, found.raw, strict=True))
    for one in (samples(parts), medians(parts)):
        check(one, effort, "tradeoff/")
    assert parts.errors["multiband", "float32", 4096][0] < 1.2 * parts.errors["multiband", "float32", 32768][0]
    assert max(parts.rounding["hedley"]) < 0.01


def test_tolerance_of_a_small_sea(effort, monkeypatch):
    monkeypatch.setattr(tolerance, "QUICK_SIDE", 832)
    monkeypatch.setattr(tolerance, "TOLERANCES", (0.1, 0.0001))
    kept = tolerance.measure(effort)
    numbers = check(tolerance.section(kept), effort, "tradeoff/tolerance")
    assert numbers["tradeoff/tolerance0.1/read"].value < 1
    assert numbers["tradeoff/tolerance0.0001/read"].value == 1
    assert numbers["tradeoff/tolerance0.0001/real"].value == 0
    assert numbers["tradeoff/tolerance0.1/real"].value < 0.1


def test_skipping(effort, monkeypatch):
    monkeypatch.setattr(skipping, "QUICK", ("no delay", "all land"))
    monkeypatch.setattr(copying, "QUICK_SIDES", (256,))
    numbers = check(skipping.run(effort), effort, "skipping/")
    assert all(numbers[f"skipping/copy/{kind}/side256/same"].value == 1 for kind in copying.KINDS)
    added = [n for name, n in numbers.items() if name.endswith("/added")]
    assert added
    assert all(n.value < 3 for n in added)
    assert numbers["skipping/all-land/saved"].value > 0
