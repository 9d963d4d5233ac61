"""How scenes, models and results show themselves: short text, and HTML with a small picture and escaped text."""

import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

import deglint
import detect
from deglint import Recipe
from deglint.errors import ReadError
from deglint.notebook import data_uri
from deglint.scene import MIDDLE


def _pictures(html):
    uris = re.findall(r"src='(data:image/png;base64,[^']+)'", html)
    return [_decoded(uri) for uri in uris]


def _decoded(uri):
    import cv2

    return cv2.imdecode(np.frombuffer(b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)


@pytest.fixture
def done(sea, write, tmp_path):
    source = write(tmp_path / "<b>in&.tif", sea(), names=("blue", "green", "<script>", "nir"))
    recipe = Recipe(method="hedley", sample="all", mask="none", compensate="off")
    return deglint.open_scene(source), deglint.remove_glint(source, tmp_path / "out.tif", recipe)


def test_texts_are_short(done, tmp_path):
    scene, result = done
    scored = detect.score_file(scene.path, tmp_path / "scores.tif", detect.Recipe(pfa=1e-2))
    for value, said in (
        (scene, "4 bands, 100 x 80 pixels"), (result, "hedley, 8000 of 8000 pixels"), (result.fitted, "hedley"),
        (result.fitted.model, "GlintModel(hedley: blue, green"), (scored, "8000 of 8000 pixels scored, threshold"),
    ):  # fmt: skip
        assert said in repr(value)
        assert len(repr(value)) < 300


def test_html_has_a_picture_and_escapes_names(done):
    scene, result = done
    for value in (scene, result):
        html = value._repr_html_()
        assert "<script>" not in html
        assert "&lt;script&gt;" in html
        (picture,) = _pictures(html)
        assert picture.std() > 5
    assert "&lt;b&gt;in&amp;.tif" in scene._repr_html_()


def test_a_picture_of_a_large_scene_reads_its_middle_alone(sea, write, tmp_path):
    scene = deglint.open_scene(write(tmp_path / "in.tif", sea(1000, 900)))
    windows = []

    class Source:
        def read(self, window, bands):
            windows.append(window)
            return scene.source.read(window, bands)

    html = replace(scene, source=Source())._repr_html_()
    assert windows == [((116, 884), (66, 834))]
    assert MIDDLE == 768
    assert max(_pictures(html)[0].shape) <= 192


def test_what_cannot_be_read_has_no_picture(done, tmp_path):
    scene, result = done
    (tmp_path / "out.tif").unlink()
    assert not _pictures(result._repr_html_())

    class Gone:
        def read(self, window, bands):
            raise ReadError("gone")

    assert not _pictures(replace(scene, source=Gone())._repr_html_())


def test_a_picture_is_a_png():
    noise = np.random.default_rng(0).integers(0, 256, (50, 50, 3), np.uint8)
    np.testing.assert_array_equal(_decoded(data_uri(noise))[..., ::-1], noise)
