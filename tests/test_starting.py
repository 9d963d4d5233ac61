"""What a fit does not do twice, or at all: work beyond what is looked at, loading what is not needed, sorting again."""

import subprocess
import sys
import threading
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.dispatcher import Dispatcher

from deglint import Recipe, correct, fit_scene, open_scene
from deglint.compensate import Chain, Sample, Setting, State, fit_stages, parse
from deglint.compensate.psf import system_psf
from deglint.compensate.spread import lower_spread
from deglint.pipeline.blocks import aside
from deglint.raster.checksum import Checksum, begin_checksum
from deglint.pipeline.warming import warm_up, warming
from deglint.remove.levels import mode, quantile
from deglint.scene import Band

SEA = Path(__file__).parents[1] / "sample_data" / "sea.tif"
WAVELENGTHS = (480.0, 560.0, 660.0, 830.0)
SETTING = Setting(
    tuple(Band(f"L{w:g}", w, saturation=400.0) for w in WAVELENGTHS),
    tuple(system_psf(w, f_number=10, pitch=8e-6) for w in WAVELENGTHS), detail=True,
)  # fmt: skip
CHAINS = (
    "identify-level:5, replace-level",
    "psf:2, identify-level:13, replace-level",
    "psf:1, identify-level:7, replace-level, identify-level:5, replace-level",
    "psf:1, identify-level:7, identify-level:5, replace-level",
    "psf-image:1, identify-median, median:9",
    "normalise:30, psf:1, identify-level:5, replace-level",
    "normalise, identify-median:5, replace-bands, median:5",
)


def blocks():
    """Two blocks of glinted sea with halos that are wider than is needed, and their tiles."""
    rng = np.random.default_rng(3)
    block = np.array([50.0, 40.0, 30.0, 10.0])[:, None, None] + rng.normal(0, 1, (2, 4, 190, 200))
    block += np.where(rng.random(block.shape) < 0.15, rng.gamma(1.0, 60.0, block.shape), 0)
    inside = np.zeros((2, 190, 200), np.bool_)
    inside[0, 80:118, 83:120] = inside[1, 75:110, 80:125] = True
    return block.astype(np.float32), inside & (rng.random(inside.shape) < 0.9)


@pytest.mark.parametrize("text", CHAINS)
def test_what_is_cut_off_is_not_looked_at(text):
    steps, cuts = parse(text)[:-1], [(70, 65, 75, 74), (68, 72, 71, 66)]
    fits, images = {}, {}
    for way, given_cuts in (("whole", ()), ("cut", cuts), ("none", None)):
        values, inside = blocks()
        sample = Sample([State.own(v) for v in values], list(inside))
        fits[way] = Chain(fit_stages(steps, sample, SETTING, cuts=given_cuts)).numbers()
        images[way] = [s.image for s in sample.states]
    assert fits["whole"] == fits["cut"] == fits["none"]
    for (top, bottom, left, right), whole, cut in zip(cuts, images["whole"], images["cut"], strict=True):
        np.testing.assert_array_equal(whole[:, top : 190 - bottom, left : 200 - right], cut)


def test_an_empty_block_of_a_sample_says_nothing():
    values, inside = blocks()
    steps = parse("psf:2, identify-level:7, replace-level")[:-1]
    alone = fit_stages(steps, Sample([State.of(values[0])], [inside[0]]), SETTING)
    both = fit_stages(steps, Sample([State.of(v) for v in values], [inside[0], inside[1] & False]), SETTING)
    assert Chain(alone).numbers() == Chain(both).numbers()


@settings(deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.floats(0, 1))
def test_a_quantile_of_sorted_values_is_numpys(values, share):
    ordered = np.sort(values)
    assert quantile(ordered, share) == np.quantile(ordered, share)


@settings(deadline=None)
@given(st.lists(st.integers(-40, 40), min_size=1, max_size=60), st.floats(-50, 50), st.sampled_from([1.0, 0.3]))
def test_a_spread_is_that_of_the_values_below(values, middle, scale):
    values = (np.array(values) * scale).astype(np.float32)
    below = np.float32(middle) - values[values <= np.float32(middle)]
    assert lower_spread(values, middle) == (1.4826 * float(np.median(below)) if below.size else 0.0)


def test_a_mode_of_sorted_values_is_that_of_all():
    values = np.random.default_rng(0).gamma(5.0, 20.0, 5000).astype(np.float32)
    assert mode(values) == mode(np.sort(values), ordered=True)


def test_a_fit_and_a_correction_compile_nothing_that_was_not_warmed_up():
    list(warm_up())
    rooms = tuple(f"deglint.{room}._" for room in ("compensate", "raster", "remove"))
    modules = [m for name, m in sys.modules.items() if name.startswith(rooms)]
    kernels = [k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)]
    before = [k.signatures for k in kernels]
    assert len([k for k in before if k]) > 8
    scene = open_scene(SEA)
    fitted = fit_scene(scene, Recipe(smallest_object="16px"), threads=2)
    assert fitted.chain.runs
    correct(scene, fitted, window=((0, 64), (0, 64)))
    assert [k.signatures for k in kernels] == before


def test_warming_ends_with_what_it_serves(monkeypatch):
    done = []

    ended = threading.Event()

    def steps():
        for i in range(100):
            done.append(i)
            ended.wait(0.2)
            yield

    monkeypatch.setattr("deglint.pipeline.warming.warm_up", steps)
    monkeypatch.setattr("deglint.pipeline.warming.LAST", "no such module")
    with pytest.raises(KeyError), warming(True):
        raise KeyError
    assert len(done) < 100
    assert not [t for t in threading.enumerate() if t.name == "deglint-warming"]


def test_what_is_done_aside_is_returned_or_raised():
    assert aside(lambda: 7).result() == 7
    with pytest.raises(ZeroDivisionError):
        aside(lambda: 1 / 0).result()


def test_a_checksum_is_begun_once_and_anew_where_the_file_changed(tmp_path):
    file = tmp_path / "scene.tif"
    file.write_bytes(b"a" * 5_000_000)
    begin_checksum([str(file)])
    first = Checksum([str(file)])
    assert first.result() == [{"path": str(file), "bytes": 5_000_000, "crc32": f"{crc32(b'a' * 5_000_000):08x}"}]
    assert Checksum([str(file)]) is not first
    begin_checksum([str(file)])
    file.write_bytes(b"b")
    assert Checksum([str(file)]).result()[0]["crc32"] == f"{crc32(b'b'):08x}"
    begin_checksum([str(tmp_path)])
    assert Checksum([str(tmp_path)]).result() == [{"path": str(tmp_path), "bytes": None, "crc32": None}]


@pytest.mark.parametrize("module", ["deglint.cli.remove", "detect.cli.score"])
def test_a_command_is_ready_to_read_before_it_loads_numpy(module):
    code = f"import sys, {module}; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_command_loads_no_scipy_that_it_does_not_use(tmp_path):
    """NumPy's and numba's own looks at SciPy aside, which load no more than its version."""
    code = (
        "import sys, deglint.cli; assert deglint.cli.run(['remove', *sys.argv[1:]]) == 0;"
        "print([m for m in sys.modules if m in ('scipy.linalg', 'scipy.ndimage', 'scipy.optimize', 'sklearn')])"
    )
    call = [sys.executable, "-c", code, str(SEA), str(tmp_path / "out.tif"), "-q", "--smallest-object", "16px"]
    done = subprocess.run(call, capture_output=True, text=True, check=False, cwd=SEA.parents[1])
    assert (done.stdout.strip(), done.stderr) == ("[]", "")
