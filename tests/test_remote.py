"""Scenes on a server: read as files are, and a server that stalls is given up in bounded time, with one line."""

import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from deglint.errors import ReadError
from deglint.raster.environment import HTTP_PATIENCE, environment
from deglint.readers import open_scene

from .common import RUN

LITTLE_PATIENCE = {"GDAL_HTTP_LOW_SPEED_TIME": "1", "GDAL_HTTP_LOW_SPEED_LIMIT": "1000", "GDAL_HTTP_MAX_RETRY": "0"}
SERVER = """
    import sys, time
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
    from pathlib import Path

    after = int(sys.argv[1])

    class Handler(BaseHTTPRequestHandler):
        def do_HEAD(self):
            self.answer(body=False)

        def do_GET(self):
            self.answer(body=True)

        def answer(self, *, body):
            if after == 0:
                time.sleep(600)
            path = Path(self.path[1:])
            data = path.read_bytes() if path.is_file() else None
            asked = self.headers.get("Range")
            first, _, last = (asked or "bytes=0-")[6:].partition("-")
            part = (data or b"")[int(first) : int(last or 1 << 60) + 1]
            self.send_response(404 if data is None else 206 if asked else 200)
            self.send_header("Content-Length", str(len(part)))
            if data is not None:
                self.send_header("Accept-Ranges", "bytes")
                self.send_header("Content-Range", f"bytes {first}-{int(first) + len(part) - 1}/{len(data)}")
            self.end_headers()
            if body:
                self.wfile.write(part[: max(after - int(first), 0)])
                if int(first) + len(part) > after:
                    self.wfile.flush()
                    time.sleep(600)

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    print(server.server_port, flush=True)
    server.serve_forever()
"""


@pytest.fixture
def serve(tmp_path, monkeypatch):
    """Serve tmp_path on loopback: serve(after) is the address; from byte `after` of a file on, nothing comes."""
    servers = []
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)

    def start(after=1 << 60):
        call = [sys.executable, "-c", textwrap.dedent(SERVER), str(after)]
        quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        servers.append(subprocess.Popen(call, cwd=tmp_path, **quiet))
        return f"http://127.0.0.1:{int(servers[-1].stdout.readline())}"

    yield start
    for server in servers:
        server.kill()
        server.wait()
        server.stdout.close()


def test_a_scene_on_a_server_is_a_scene(deglint, sea, write, read, tmp_path, serve):
    write(tmp_path / "in.tif", sea(120, 120), tiled=True, blockxsize=64, blockysize=64)
    assert deglint("remove", tmp_path / "in.tif", tmp_path / "file.tif", *RUN).code == 0
    ran = deglint("remove", f"{serve()}/in.tif", tmp_path / "web.tif", *RUN)
    assert ran.code == 0, ran.err
    np.testing.assert_array_equal(read(tmp_path / "web.tif"), read(tmp_path / "file.tif"))


def test_a_store_that_wants_credentials_says_how_to_do_without(monkeypatch):
    said = "AWS_SECRET_ACCESS_KEY and AWS_NO_SIGN_REQUEST configuration options not defined"
    monkeypatch.setattr("rasterio.open", lambda *_, **__: (_ for _ in ()).throw(OSError(said)))
    with pytest.raises(ReadError, match=r"Give credentials.*AWS_NO_SIGN_REQUEST=YES"):
        open_scene("s3://bucket/x.tif")


def test_a_stac_item_on_a_server_is_a_scene(sea, write, tmp_path, serve):
    (tmp_path / "items").mkdir()
    assets = {}
    for name, band in zip(("blue", "green", "red", "nir"), sea(), strict=True):
        write(tmp_path / "items" / f"{name}.tif", band[None], names=())
        assets[name] = {"href": f"{name}.tif", "type": "image/tiff", "eo:bands": [{"name": name, "common_name": name}]}
    text = json.dumps({"type": "Feature", "id": "tile", "assets": assets})
    (tmp_path / "items" / "tile").write_text(text)
    base = f"{serve()}/items"
    scene = open_scene(f"{base}/tile")
    assert scene.names == ("blue", "green", "red", "nir")
    np.testing.assert_array_equal(scene.read(), sea())
    with pytest.raises(ReadError, match=r"STAC Item http.*none: .*Check the address"):
        open_scene(f"{base}/none")


@pytest.mark.slow
@pytest.mark.parametrize("after", [0, 30_000], ids=["says nothing", "stops under way"])
def test_a_server_that_stalls_is_given_up(deglint, sea, write, tmp_path, serve, monkeypatch, after):
    write(tmp_path / "in.tif", sea(120, 120), tiled=True, blockxsize=64, blockysize=64)
    (tmp_path / "out").mkdir()
    for name, value in LITTLE_PATIENCE.items():
        monkeypatch.setenv(name, value)
    ran = deglint("remove", f"{serve(after)}/in.tif", tmp_path / "out" / "o.tif", *RUN, "-q")
    assert ran.code == 1
    assert ran.err.startswith("Error: cannot ")
    assert ran.err.count("\n") == 1
    assert "too slow" in ran.err
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.slow
def test_a_stalled_scene_does_not_stop_a_batch(deglint, sea, write, tmp_path, serve, monkeypatch):
    write(tmp_path / "in.tif", sea(120, 120), tiled=True, blockxsize=64, blockysize=64)
    monkeypatch.chdir(tmp_path)
    for name, value in LITTLE_PATIENCE.items():
        monkeypatch.setenv(name, value)
    (tmp_path / "list.csv").write_text(f"path,name\n{serve(0)}/in.tif,stalled\nin.tif,here\n{serve()}/in.tif,there\n")
    (tmp_path / "r.toml").write_text('[recipe]\nmethod = "hedley"\nsample = "all"\nmask = "none"\n')
    ran = deglint("batch", "r.toml", "list.csv", "-q")
    assert ran.code == 1
    assert "2 done" in ran.out
    assert "1 failed" in ran.out
    assert "too slow" in ran.out


def test_patience_is_bounded_and_the_environment_decides(monkeypatch):
    from rasterio.env import getenv

    with environment():
        found = getenv()
    assert {name: found[name] for name in HTTP_PATIENCE} == HTTP_PATIENCE
    assert all(float(value) > 0 for value in HTTP_PATIENCE.values())
    monkeypatch.setenv("GDAL_HTTP_MAX_RETRY", "7")
    with environment():
        assert "GDAL_HTTP_MAX_RETRY" not in getenv()
