"""The page with sliders: for this machine only, and drawn anew as they move, in a browser without a window."""

import http.client
import json
import os
import shutil
import subprocess
import threading
import time

import numpy as np
import pytest

from deglint.errors import InputError
from deglint.plan import Mission, reticle
from deglint.plan.serve import answer, make_server

from .common import BAY

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
HOSTS = ("evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "", "127.0.0.1.evil:{port}")
MOVE = """(() => {{
    const slider = form.elements.{0};
    slider.value = {1};
    slider.dispatchEvent(new Event('input', {{bubbles: true}}));
}})()"""


@pytest.fixture
def port():
    server = make_server(BAY)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield server.server_port
    server.shutdown()
    thread.join()
    server.server_close()


def get(port, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=headers)
    reply = connection.getresponse()
    body = reply.read()
    connection.close()
    return reply, body


def test_the_page_loads_nothing_from_anywhere(port):
    reply, body = get(port, "/")
    policy = reply.headers["Content-Security-Policy"]
    assert reply.status == 200
    assert "default-src 'none'" in policy
    assert "http" not in policy
    text = body.decode()
    assert "://" not in text
    assert "{{" not in text
    assert "src=" not in text


@pytest.mark.parametrize("host", HOSTS)
def test_another_host_is_refused(port, host):
    for path in ("/", "/plan?wind=5"):
        reply, body = get(port, path, Host=host.format(port=port))
        assert reply.status == 421
        assert body == b"this page is for this machine only\n"


def test_only_the_loopback_address_is_bound():
    server = make_server(BAY)
    assert server.server_address[0] == "127.0.0.1"
    with pytest.raises(InputError, match=r"not available.*--port"):
        make_server(BAY, server.server_port)
    server.server_close()


def test_a_plan_for_the_sliders(port):
    reply, body = get(
        port, "/plan?wind=5&depth=8&time=2026-06-21T20:00Z&band=GREEN&sensor=worldview3", Host=f"localhost:{port}"
    )
    assert reply.status == 200
    found = json.loads(body)
    assert found["words"].startswith("Look from")
    assert found["bands"][1] == "BLUE"
    assert len(found["pointer"]["contrast"]) == 11


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("wind=900", "wind must be 0.1 to 19.6 m/s"),
        ("depth=deep", "could not convert string to float: 'deep'"),
        ("time=2026-06-21T08:00Z", "1 degree high at"),
        ("sensor=hubble", "is not one of"),
        ("band=purple", "no band 'purple'"),
    ],
)
def test_what_cannot_be_drawn_is_said(port, query, said):
    reply, body = get(port, f"/plan?{query}")
    assert reply.status == 400
    assert said in json.loads(body)["error"]
    assert get(port, "/other")[0].status == 404


def test_sliders_of_the_sun_where_it_is_given_by_angles():
    base = Mission(sun_zenith=30.0, sun_azimuth=100.0, step=5.0)
    there = answer(base, {"sun_azimuth": "280", "sun_zenith": "30"})["pointer"]["contrast"]
    here = answer(base, {})["pointer"]["contrast"]
    assert there != here


@pytest.mark.parametrize("step", [3.0, 7.0])
def test_the_pointers_values_reach_from_end_to_end(step):
    mission = Mission(sun_zenith=70.0, sun_azimuth=180.0, wind=15.0, step=step)
    plan, found = reticle(mission), answer(mission, {})["pointer"]
    for i, j in ((0, 0), (-1, 0), (0, -1), (-1, -1)):
        assert found["contrast"][i][j] == round(plan.combined[i, j])
        assert found["glint"][i][j] == pytest.approx(np.log10(plan.glint_probability[i, j]), abs=0.051)


class Browser:
    """Chromium without a window, spoken to over a pair of pipes."""

    def __init__(self, profile):
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        flags = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run",
                 "--disable-dev-shm-usage", f"--user-data-dir={profile}", "--remote-debugging-pipe")  # fmt: skip

        def ends():  # the browser reads from 3 and writes to 4
            spare = os.dup(from_browser)
            os.dup2(to_browser, 3)
            os.dup2(spare, 4)

        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(
            [CHROMIUM, *flags], preexec_fn=ends, close_fds=False, stdin=quiet, stdout=quiet, stderr=quiet
        )
        os.close(to_browser)
        os.close(from_browser)
        self._rest, self._count, self._session = b"", 0, None

    def call(self, method, **parameters):
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                read = os.read(self._in, 1 << 16)
                if not read:
                    raise RuntimeError("the browser ended")
                self._rest += read
            line, _, self._rest = self._rest.partition(b"\0")
            reply = json.loads(line)
            if reply.get("id") == self._count:
                assert "error" not in reply, reply
                return reply["result"]

    def open(self, url):
        target = self.call("Target.createTarget", url=url)["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def value(self, expression):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def until(self, expression, seconds=40):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if found := self.value(expression):
                return found
            time.sleep(0.05)
        raise AssertionError(f"not within {seconds} s: {expression}; {self.value('document.body.innerText')}")

    def close(self):
        self._session = None
        try:
            self.call("Browser.close")
        except (OSError, RuntimeError):
            self._process.kill()
        self._process.wait(20)
        os.close(self._in)
        os.close(self._out)


@pytest.fixture
def browser(tmp_path):
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    made = Browser(tmp_path / "profile")
    yield made
    made.close()


def test_in_a_browser_the_sliders_draw_anew(port, browser):
    browser.open(f"http://127.0.0.1:{port}/")
    browser.until("document.body && document.body.dataset.drawn >= 1")
    words = browser.value("document.getElementById('words').textContent")
    assert words.startswith("Look from the east-north-east")
    assert browser.value("picture.naturalWidth") == 1240
    first = browser.value("picture.src")
    for n, (name, value) in enumerate([("wind", 3), ("minute", 1320), ("depth", 12), ("latitude", 20)], start=2):
        browser.value(MOVE.format(name, value))
        browser.until(f"document.body.dataset.drawn >= {n}")
        now = browser.value("picture.src")
        assert now != first
        first = now
    assert browser.value("document.getElementById('error').hidden") is True
    assert int(browser.value("document.body.dataset.took")) > 0
    browser.value(MOVE.format("minute", 480))
    browser.until("!document.getElementById('error').hidden")
    assert "1 degree high at" in browser.value("document.getElementById('error').textContent")
    asked = browser.value("performance.getEntriesByType('resource').map(e => new URL(e.name).host).join()")
    assert set(asked.split(",")) == {f"127.0.0.1:{port}"}


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_site_is_refused(port, site):
    for path in ("/", "/plan?wind=5"):
        assert get(port, path, **{"Sec-Fetch-Site": site})[0].status == 403
    assert get(port, "/", **{"Sec-Fetch-Site": "none"})[0].status == 200
    assert get(port, "/", **{"Sec-Fetch-Site": "same-origin"})[0].status == 200


def test_a_client_that_leaves_is_no_fault(port, capfd):
    import socket
    import struct

    for sent in (b"", b"GET /plan HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % port, b"GET / HT"):
        with socket.create_connection(("127.0.0.1", port)) as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # reset, not closed
            client.sendall(sent)
    get(port, "/plan")
    for thread in threading.enumerate():
        if "process_request" in thread.name:
            thread.join(20)
    assert capfd.readouterr().err == ""
