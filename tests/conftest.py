"""Small scenes of the sea for the tests of the whole job: made here, never read from beside the project.

Property tests draw the same examples in every run; HYPOTHESIS_PROFILE=explore lets them look for new ones.
"""

import json
import os
import re
import signal
from collections import Counter, namedtuple
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # each worker has a processor: threads of BLAS would wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings

from .common import NAMES, PLACE, WATER, read_raster, write_bare

settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in the background: programs that tests interrupt inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:  # as under nohup: likewise
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_addoption(parser):
    parser.addoption("--every", type=int, default=1, metavar="N", help="run of each file only every Nth test")
    parser.addoption("--write-docs", action="store_true", help="write the tables in docs/ that tests keep equal")


def pytest_collection_modifyitems(config, items):
    """Of each file the first test, and every Nth after it."""
    step, seen = config.getoption("every"), Counter()
    chosen, left = [], []
    for item in items:
        (left if seen[item.path] % step else chosen).append(item)
        seen[item.path] += 1
    if left:
        config.hook.pytest_deselected(items=left)
        items[:] = chosen


SLOPES = np.array([1.1, 1.0, 0.9, 1.0])


def make_sea(height=80, width=100, dtype="uint16", seed=0, factor=1.0):
    """Blue, green, red and NIR of even water under glint: (4, height, width) in file numbers."""
    rng = np.random.default_rng(seed)
    glint = rng.gamma(0.5, 120.0, (height, width))
    noise = rng.normal(0, 3, (4, height, width))
    sea = (WATER + SLOPES[:, None, None] * glint + noise).clip(10, 30_000) * factor
    return np.rint(sea).astype(dtype) if np.dtype(dtype).kind in "iu" else sea.astype(dtype)


def write_raster(path, array, *, names=NAMES, **options):
    """Write an array (band, row, column) as a raster, in UTM unless the options say otherwise."""
    return write_bare(path, array, names=names, **(PLACE | options))


def write_geojson(path, *rings, crs=None, kind="Polygon", **members):
    """Write polygons, each given by its outer ring."""
    geometries = [{"type": "Polygon", "coordinates": [[list(map(float, p)) for p in ring]]} for ring in rings]
    if kind == "MultiPolygon":
        geometries = [{"type": kind, "coordinates": [g["coordinates"] for g in geometries]}]
    if kind == "GeometryCollection":
        geometries = [{"type": kind, "geometries": geometries}]
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    document = {"type": "FeatureCollection", "features": features, **members}
    if crs:
        document["crs"] = {"type": "name", "properties": {"name": crs}}
    Path(path).write_text(json.dumps(document))
    return str(path)


@pytest.fixture
def sea():
    return make_sea


@pytest.fixture
def write():
    return write_raster


@pytest.fixture
def geojson():
    return write_geojson


@pytest.fixture
def read():
    return read_raster


Ran = namedtuple("Ran", "code out err")


@pytest.fixture
def command(capfd):
    """Turn a program's `run` into a function that runs it in this process: exit code, stdout and stderr.

    Where it fails, `err` begins with the error: what was logged before is left out.
    """

    def program(run):
        def call(*arguments):
            capfd.readouterr()
            code = run([str(a) for a in arguments])
            out, err = capfd.readouterr()
            begins = re.search("^(Error|Usage|Traceback|interrupted)", err, re.MULTILINE) if code else None
            return Ran(code, out, err[begins.start() :] if begins else err)

        return call

    return program


@pytest.fixture
def deglint(command):
    """Run the command in this process: deglint("remove", ...) gives its exit code, stdout and stderr."""
    from deglint.cli import run

    return command(run)


@pytest.fixture
def rxdetect(command):
    """The same for rxdetect("score", ...)."""
    from detect.cli import run

    return command(run)
