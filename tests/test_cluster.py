"""Tiles on the workers of a real cluster: the same bits as on threads, whatever becomes of a worker."""

import json
import operator
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext

import numpy as np
import pytest
import rasterio

from deglint import Recipe, fit_scene, open_scene, remove_glint
from deglint.errors import DeglintError, InputError, ReadError

pytest.importorskip("distributed", reason="needs pip install 'deglint[cluster]'")

from deglint.cluster import Cluster, connect
from deglint.tiles import run as run_threads
from deglint.tiles import tiles
from detect.pipeline import Recipe as Scoring
from detect.pipeline import score_file

from .common import RUN, says

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed", "ignore::ResourceWarning")
LIMIT = 1 << 30
TILED = {"tiled": True, "blockxsize": 64, "blockysize": 64, "compress": "deflate"}
CHAIN = "identify-level:7, replace-level, remove, identify-level:5, replace-level"
RECIPES = {
    "automatic": Recipe(),
    "over everything": Recipe(method="joyce", sample="all", mask="none"),
    "robust": Recipe(method="hedley", sample="10,20,90,70", mask="30,30,300,300", regression="huber"),
    "chain": Recipe(compensate=CHAIN),
}


@pytest.fixture(scope="module")
def cluster():
    with connect(workers=2, memory="1GiB") as found:
        yield found


@pytest.fixture
def scene(sea, write, tmp_path, monkeypatch):
    """Many tiles, with land, a boat and nodata, named from its own directory."""
    raw = sea(420, 380)
    raw[:, 200:260, 100:220] = 6000
    raw[:, 300:304, 320:330] = 9000
    raw[:, :50, 300:] = 0
    monkeypatch.setattr("deglint.tiles.SAMPLES", 4 * 64 * 64)
    monkeypatch.setattr("deglint.tiles.COMPACT", 128)
    write(tmp_path / "in.tif", raw, nodata=0, **TILED)
    monkeypatch.chdir(tmp_path)
    return "in.tif"


def run(source, folder, recipe, **options):
    folder.mkdir()
    result = remove_glint(
        source, folder / "out.tif", recipe, flags=folder / "f.tif", amount=folder / "a.tif", **options
    )
    assert sorted(p.name for p in folder.iterdir()) == ["a.tif", "f.tif", "f.tif.aux.xml", "out.tif", "out.tif.json"]
    return result


def assert_same(one, other, names=("out.tif", "f.tif", "a.tif")):
    for name in names:
        with rasterio.open(one / name) as a, rasterio.open(other / name) as b:
            np.testing.assert_array_equal(a.read(), b.read())
            np.testing.assert_array_equal(a.read_masks(), b.read_masks())
            assert a.tags() == b.tags()
            assert repr(a.profile) == repr(b.profile)


def said(folder):
    found = json.loads((folder / "out.tif.json").read_text())
    return {k: v for k, v in found.items() if k not in ("seconds", "output", "cluster")}


@pytest.mark.slow
@pytest.mark.parametrize("name", RECIPES)
def test_workers_give_what_threads_give(cluster, scene, tmp_path, name):
    run(scene, tmp_path / "threads", RECIPES[name])
    run(scene, tmp_path / "workers", RECIPES[name], cluster=cluster)
    assert_same(tmp_path / "threads", tmp_path / "workers")
    assert said(tmp_path / "threads") == said(tmp_path / "workers")


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["fit", "correct"])
def test_a_worker_killed_in_mid_run_changes_nothing(cluster, scene, tmp_path, stage):
    recipe = RECIPES["over everything"]
    run(scene, tmp_path / "threads", recipe)
    before = cluster.client.run(os.getpid)
    killed = []

    def progress(now, done, total):
        if now == stage and done >= 3 and not killed:
            assert total > 20
            killed.append(next(iter(before.values())))
            os.kill(killed[0], signal.SIGKILL)

    run(scene, tmp_path / "workers", recipe, cluster=cluster, progress=progress)
    assert killed
    cluster.client.wait_for_workers(2, timeout=60)
    assert killed[0] not in cluster.client.run(os.getpid).values()
    assert_same(tmp_path / "threads", tmp_path / "workers")
    assert said(tmp_path / "threads") == said(tmp_path / "workers")


@pytest.mark.slow
@pytest.mark.parametrize(
    "recipe",
    [Scoring(mask="water", pfa=1e-3), Scoring(covariance="ledoit-wolf"), Scoring(method="local", window=(3, 9))],
    ids=["water", "ledoit-wolf", "local"],
)
def test_scores_are_the_same(cluster, scene, tmp_path, recipe):
    p_value = {"p_value": "p.tif"} if recipe.pfa else {}
    names = ["out.tif", *p_value.values()]
    for folder, options in (("threads", {}), ("workers", {"cluster": cluster})):
        (tmp_path / folder).mkdir()
        outputs = {k: tmp_path / folder / v for k, v in p_value.items()}
        score_file(scene, tmp_path / folder / "out.tif", recipe, **outputs, **options)
    assert_same(tmp_path / "threads", tmp_path / "workers", names)
    assert said(tmp_path / "threads") == said(tmp_path / "workers")


def test_a_fit_alone_is_that_of_threads(cluster, scene):
    recipe = RECIPES["robust"]
    opened = open_scene(scene)
    assert fit_scene(opened, recipe, run=cluster.run).model == fit_scene(opened, recipe).model


def test_memory_of_a_worker_is_told_and_below_its_limit(cluster, scene, tmp_path):
    run(scene, tmp_path / "workers", RECIPES["chain"], cluster=cluster)
    held = cluster.memory()
    assert len(held) == 2
    assert all(0 < n < LIMIT for n in held.values())
    noted = json.loads((tmp_path / "workers" / "out.tif.json").read_text())["cluster"]
    assert noted["workers"] == 2
    assert 0 < noted["most_memory_of_one_MB"] <= max(held.values()) / 1e6 + 0.1


def test_as_many_workers_as_wanted():
    with connect(workers=1) as found:
        assert len(found.client.nthreads()) == 1


def test_local_workers_share_the_memory_of_the_machine():
    """Given "auto", distributed divides the memory by the number of processors, whatever the number of workers."""
    from distributed.system import MEMORY_LIMIT

    with connect(workers=3) as found:
        workers = found.client.scheduler_info(n_workers=-1)["workers"].values()
        assert [worker["memory_limit"] for worker in workers] == pytest.approx([MEMORY_LIMIT / 3] * 3)


@pytest.mark.parametrize(
    ("lost", "error"), [("LocalCluster", RuntimeError("it failed\nto start")), ("Client", TimeoutError("too slow"))]
)
def test_local_workers_that_do_not_start_are_one_line(monkeypatch, lost, error):
    def fail(*_given, **_options):
        raise error

    monkeypatch.setattr("distributed.LocalCluster", lambda **_options: nullcontext())
    monkeypatch.setattr(f"distributed.{lost}", fail)
    with pytest.raises(DeglintError, match=r"cannot start workers.*\((it failed to start|too slow)\)"):
        connect(workers=2).__enter__()


def test_tiles_come_in_order(cluster):
    everything = tiles(300, 500, (100, 100))
    work = operator.attrgetter("col0", "row1")
    assert list(cluster.run(everything, work)) == list(run_threads(everything, work))


def test_commands_take_the_address_of_a_cluster(cluster, deglint, scene, tmp_path):
    address = cluster.client.scheduler.address
    assert deglint("remove", scene, "threads.tif", *RUN).code == 0
    ran = deglint("remove", scene, "workers.tif", *RUN, "--cluster", address)
    assert ran.code == 0, ran.err
    assert "2 workers, largest peak memory" in ran.err
    with rasterio.open("threads.tif") as a, rasterio.open("workers.tif") as b:
        np.testing.assert_array_equal(a.read(), b.read())


def test_what_fails_on_a_worker_is_one_line_here_and_leaves_nothing(cluster, scene, tmp_path):
    whole = (tmp_path / scene).read_bytes()
    (tmp_path / "short.tif").write_bytes(whole[: len(whole) * 2 // 3])
    (tmp_path / "out").mkdir()
    with pytest.raises(ReadError, match="damaged") as caught:
        remove_glint("short.tif", tmp_path / "out" / "out.tif", RECIPES["over everything"], cluster=cluster)
    assert "\n" not in str(caught.value)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    "options",
    [
        ("--workers", "2", "--cluster", "tcp://127.0.0.1:1"),
        ("--workers", "2", "--threads", "2"),
        ("--workers", "0"),
        ("--cluster", "tcp://127.0.0.1:1", "--worker-memory", "1GiB"),
    ],
)
def test_options_that_exclude_each_other(deglint, scene, options):
    assert deglint("remove", scene, "out.tif", *RUN, *options).code == 2


def test_addresses_that_lead_nowhere(deglint, scene, monkeypatch):
    ran = deglint("remove", scene, "out.tif", *RUN, "--cluster", "localhost")
    assert (ran.code, ran.err.count("\n")) == (1, 1)
    assert says(ran.err, "Error: the address", "tcp://HOST:PORT", "'localhost'")
    monkeypatch.setattr("deglint.cluster._CONNECT", 0.5)
    ran = deglint("remove", scene, "out.tif", *RUN, "--cluster", "tcp://127.0.0.1:1")
    assert ran.code == 1
    assert says(ran.err, "cannot reach", "tcp://127.0.0.1:1")


@pytest.mark.slow
def test_an_input_that_is_not_there_starts_no_workers(deglint, tmp_path):
    ran = deglint("remove", tmp_path / "none.tif", tmp_path / "out.tif", "--workers", "2")
    assert ran.code == 1
    assert "no such file" in ran.err


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(DeglintError, match=r"pip install 'deglint\[cluster\]'"), connect(workers=1):
        pass


def test_the_memory_of_a_worker_is_a_size(deglint, scene):
    ran = deglint("remove", scene, "out.tif", *RUN, "--workers", "1", "--worker-memory", "much")
    assert (ran.code, ran.err.count("\n")) == (1, 1)
    assert "such as 1GiB" in ran.err


@pytest.mark.parametrize(
    ("options", "said"),
    [(("--cluster", "foo"), "tcp://HOST:PORT"), (("--workers", "2", "--worker-memory", "3zz"), "such as 1GiB")],
)
def test_a_dry_run_checks_the_cluster_and_starts_none(deglint, scene, monkeypatch, options, said):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert said in deglint("remove", scene, "out.tif", *RUN, *options, "--dry-run").err
    assert deglint("remove", scene, "out.tif", *RUN, "--workers", "2", "--dry-run").code == 0


def test_a_cluster_is_named_in_one_way():
    with pytest.raises(InputError, match="one of the two"), connect():
        pass


@pytest.fixture
def elsewhere(tmp_path):
    """A scheduler and a worker as processes of their own: (address, scheduler)."""
    said = tmp_path / "scheduler.json"
    common = ["--scheduler-file", str(said), "--no-dashboard"]
    call = [sys.executable, "-W", "ignore", "-m", "distributed.cli.dask_"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    local = ["--host", "127.0.0.1"]
    scheduler = subprocess.Popen([*call[:-1], f"{call[-1]}scheduler", *common, *local, "--port", "0"], **quiet)
    worker = subprocess.Popen([*call[:-1], f"{call[-1]}worker", *common, "--nthreads", "1", "--no-nanny"], **quiet)
    try:
        until = time.monotonic() + 30
        while not (said.exists() and said.read_text()) and time.monotonic() < until:
            time.sleep(0.1)
        yield json.loads(said.read_text())["address"], scheduler
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["fit", "correct"])
def test_a_scheduler_that_is_lost_is_one_line(elsewhere, scene, tmp_path, stage):
    address, scheduler = elsewhere
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "out.tif").write_bytes(b"old")

    def progress(now, done, total):
        if now == stage:
            scheduler.kill()

    with connect(address) as found, pytest.raises(DeglintError, match="lost the cluster") as caught:
        remove_glint(scene, tmp_path / "out" / "out.tif", RECIPES["over everything"], cluster=found,
                     progress=progress, overwrite=True)  # fmt: skip
    assert "\n" not in str(caught.value)
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["out.tif"]
    assert (tmp_path / "out" / "out.tif").read_bytes() == b"old"


@pytest.mark.slow
@pytest.mark.parametrize("lost_by", ["the future", "the client"])
def test_a_scheduler_that_is_lost_while_it_is_asked_is_one_line(lost_by):
    from distributed.client import FutureCancelledError
    from distributed.comm import CommClosedError

    class Future:
        def result(self, timeout=None):
            if timeout is None:
                raise FutureCancelledError("a-key", "scheduler-connection-lost")
            raise TimeoutError("timed out")

        def done(self):
            return lost_by == "the future"

    class Client:
        def nthreads(self):
            raise CommClosedError("ConnectionPool closing.")

    with pytest.raises(DeglintError, match="lost the cluster"):
        Cluster(Client())._result(Future())
