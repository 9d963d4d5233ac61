"""The public names: what type checkers see of them, and what they say of a wrong value."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import deglint
import detect
from deglint import Recipe
from deglint.compensate import Chain
from deglint.errors import ReadError
from deglint.pipeline import Fitted

from .common import ROOT, says


@pytest.mark.parametrize("package", [deglint, detect])
def test_checkers_are_shown_the_names_that_are_loaded(package):
    tree = ast.parse(Path(package.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    shown = {alias.asname: node.module for node in imports for alias in node.names}
    assert sorted(shown) == sorted(package.__all__)
    assert isinstance(package.__version__, str)
    assert Path(package.__file__).with_name("py.typed").exists()
    for name, home in shown.items():
        assert hasattr(package, name), name
        assert hasattr(importlib.import_module(f"{package.__name__}.{home}"), name)


@pytest.mark.slow
def test_mypy_knows_signatures_and_misspelt_names(tmp_path):
    pytest.importorskip("mypy")
    script = tmp_path / "script.py"
    script.write_text(
        "import deglint, detect\n"
        "reveal_type(deglint.open_scene)\n"
        "reveal_type(detect.rx)\n"
        "deglint.remove_glint('a.tif', 'b.tif', deglint.Recipe(metod='hedley'))\n"
        "deglint.opne_scene\n"
    )
    call = [sys.executable, "-m", "mypy", "--follow-imports=silent", str(script)]
    said = subprocess.run(call, capture_output=True, text=True, check=False, cwd=ROOT).stdout
    assert "-> deglint.scene.Scene" in said
    assert 'note: Revealed type is "def (image: numpy.ndarray' in said
    assert 'Unexpected keyword argument "metod"' in said
    assert 'has no attribute "opne_scene"' in said


def test_rx_is_called_with_an_array(sea):
    image = sea(dtype="float32")
    image[:, 20, 30] *= 3
    scores = detect.rx(image)
    assert scores.shape == image.shape[1:]
    assert np.unravel_index(scores.argmax(), scores.shape) == (20, 30)
    image[1, 5, 6] = -999
    image[2, 8, 9] = np.nan
    for left in (detect.rx(image, nodata=-999), detect.rx(np.ma.masked_equal(image, -999))):
        assert np.argwhere(np.isnan(left)).tolist() == [[5, 6], [8, 9]]
    mask = np.ones(scores.shape, np.bool_)
    mask[40:] = False
    assert np.isnan(detect.rx(image, mask=mask, nodata=-999)).sum() == mask.size - mask.sum() + 2


@pytest.mark.parametrize(
    ("field", "given", "kept"),
    [("nir", "NIR1,NIR2", ("NIR1", "NIR2")), ("nir", 8, ("8",)), ("bands", [1, "B3"], ("1", "B3")),
     ("sample", Path("deep.geojson"), "deep.geojson"), ("mask", (10, 20, 30, 40), "10,20,30,40")],
)  # fmt: skip
def test_a_recipe_takes_what_is_plain(field, given, kept):
    assert getattr(Recipe(**{field: given}), field) == kept


ARRAY = np.ones((4, 20, 20), np.float32)
FITTED = Fitted(deglint.GlintModel("hedley", (), (), ()), Recipe())


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda _: Recipe(metod="hedley"), "Recipe: ... 'metod' ... mean 'method'?"),
        (lambda _: Recipe(method="hedly"), "kutser, nir-subtraction ... mean 'hedley'?"),
        (lambda _: Recipe(nir=ARRAY), "by number (from 1), or a list of them ... an array of shape (4, 20, 20)"),
        (lambda _: Recipe(nir=True), "by number (from 1), or a list of them ... True"),
        (lambda _: Recipe(mask=ARRAY), "mask: want a file name ... an array of shape (4, 20, 20)"),
        (lambda _: Recipe(floor_percentile="5"), "want a number from 0 to 100 ... '5'"),
        (lambda _: Recipe(method="joyce", floor_percentile=5), "--floor-percentile ... hedley or multiband"),
        (lambda _: Recipe(regression="ols"), "--regression ... hedley or lyzenga or joyce, not auto"),
        (lambda _: Recipe(method="hedley", rrs_factor=1.0), "--rrs-factor ... goodman, not hedley"),
        (lambda _: Recipe(compensate=None), "want a text ... None. Give 'auto'"),
        (lambda s: deglint.fit_scene(s, Recipe(nir="NIR1")), "no band 'NIR1' in"),
        (lambda s: deglint.fit_scene(s, Recipe(nir=8)), "numbers 1-4: 1 blue (485 nm)"),
        (lambda s: deglint.fit_scene(s.path), "Open it with deglint.open_scene"),
        (lambda s: deglint.fit_scene(s, "hedley"), "Make one: deglint.Recipe(method='hedley')"),
        (lambda s: deglint.examine(s.path), "Open it with deglint.open_scene"),
        (lambda s: deglint.find_nir(s.path), "Open it with deglint.open_scene"),
        (lambda s: deglint.correct(s, Recipe()), "fitted: want a Fitted ... a Recipe. Make it with"),
        (lambda s: deglint.open_scene(s.path, senosr="x"), "did you mean 'sensor'?"),
        (lambda s: deglint.open_scene(ARRAY), "Arrays go to deglint.fit and deglint.apply"),
        (lambda s: deglint.open_scene(s.path, nodata="x"), "want a number from -inf to inf ... 'x'"),
        (lambda s: deglint.open_scene(s.path, nodata=10**5000), "got an integer beyond double precision"),
        (lambda s: deglint.remove_glint(s.path, "x.tif", flag="f.tif"), "did you mean 'flags'?"),
        (lambda s: deglint.remove_glint(s.path, ARRAY), "image: want a file name ... an array"),
        (lambda s: deglint.remove_glint(s.path, "x.tif", threads=0), "threads: ... 1 to 1024 ... 0"),
        (lambda s: deglint.remove_glint(s.path, "x.tif", dtype="unit16"), "did you mean 'uint16'?"),
        (lambda s: deglint.remove_glint(s.path, "x.tif", model="m.json"), "deglint.pipeline.load_model"),
        (lambda s: deglint.remove_glint(s.path, "x.tif", chain="thesis"), "chain: want a Chain ... 'thesis'. Read"),
        (lambda s: deglint.remove_glint(s.path, "x.tif", chain=Chain()), "model: want a GlintModel ... None. A chain"),
        (lambda s: deglint.fit_scene(s, threads=-1), "threads: ... 1 to 1024 ... -1"),
        (lambda s: deglint.examine(s, threads="2"), "threads: ... 1 to 1024 ... '2'"),
        (lambda s: deglint.examine(s, threads=0), "threads: ... 1 to 1024 ... 0"),
        (lambda s: s.read(bands=[1.7]), "no band 1.7 in"),
        (lambda s: deglint.correct(s, FITTED, window=((0.0, 5), (0, 5))), "window: want ((row0, row1), (column0"),
        (lambda _: deglint.fit("hedley", ARRAY, nir="NIR"), "want 0-based numbers of bands of the array ... 'NIR'"),
        (lambda _: deglint.fit("hedley", ARRAY, nir=4), "not among the 4 bands (counted from 0)"),
        (lambda _: deglint.fit("hedley", ARRAY, nir=3, correct=[7]), "correct: band(s) [7] are not among the 4 bands"),
        (lambda _: deglint.fit("hedley", ARRAY, nir=3, correct=[-1]), "correct: band(s) [-1] are not among the 4"),
        (lambda _: deglint.fit("hedley", ARRAY, nir=3, correct=["blue"]), "correct: want 0-based numbers of bands"),
        (lambda _: deglint.fit("hedley", ARRAY, nir=3, bands=[deglint.Band("a")] * 5), "each of the 4 bands"),
        (lambda _: deglint.fit("wiener", ARRAY[:, :0], nir=3), "array with pixels ... shape (4, 0,"),
        (lambda _: deglint.fit("hedley", ARRAY, nir=1, regresion="ols"), "did you mean 'regression'?"),
        (lambda s: deglint.apply(s.path, None), "block: want a ndarray, got"),
        (lambda _: deglint.apply(ARRAY, "m.json"), "model: want a GlintModel ... 'm.json'"),
        (lambda _: detect.rx(ARRAY, maks=None), "rx: ... 'maks' ... mean 'mask'?"),
        (lambda _: detect.local_rx(ARRAY, iner=3, outer=9), "no argument 'iner' ... mean 'inner'?"),
        (lambda _: detect.Recipe(metod="rx"), "did you mean 'method'?"),
        (lambda s: detect.score_file(s.path, "x.tif", obects="o"), "did you mean 'objects'?"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_named_in_one_line(call, said, sea, write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = deglint.open_scene(write(tmp_path / "in.tif", sea()))
    with pytest.raises((deglint.DeglintError, TypeError)) as raised:
        call(scene)
    assert says(str(raised.value), *said.split(" ... "))
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "x.tif").exists()


def test_a_wrong_sample_leaves_no_time_limit_on_a_scene(sea, write, tmp_path):
    scene = deglint.open_scene(write(tmp_path / "in.tif", sea()))
    with pytest.raises(ReadError):
        deglint.examine(scene, Recipe(sample="missing.geojson"))
    assert scene.source.deadline == float("inf")
