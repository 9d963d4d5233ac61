"""A local web page with sliders: the plan is redrawn when wind, time, place or depth change.

The server is bound to the loopback address; requests that name another host are rejected, as a foreign web page could
make a browser send them. The page is self-contained.
"""

from __future__ import annotations

import base64
import json
import secrets
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from ..errors import DeglintError, InputError
from ..physics.presets import PRESETS
from .advice import best_geometry, description
from .draw import png
from .mission import Mission
from .missionfile import merged, mission_from, tables_of
from .picture import DISC_CENTRE, DISC_RADIUS, HEIGHT, WIDTH, picture
from .reticle import Reticle, reticle

ADDRESS = "127.0.0.1"
_PAGE_NUMBERS = {  # name in the page: table and key of the mission
    "latitude": ("place", "latitude"),
    "longitude": ("place", "longitude"),
    "sun_zenith": ("sun", "zenith"),
    "sun_azimuth": ("sun", "azimuth"),
    "wind": ("wind", "speed"),
    "wind_from": ("wind", "from"),
    "depth": ("object", "depth"),
    "reflectance": ("object", "reflectance"),
    "chlorophyll": ("water", "chlorophyll"),
    "visibility": ("air", "visibility"),
    "glint": ("limits", "glint"),
}
PLANS_AT_ONCE = 2
"""Plans that are drawn at the same time; each needs about 15 MB and a processor."""
WAIT = 5.0
"""Time that a further request waits [s]; browsers and proxies wait for 30 s or more."""
Answer = tuple[HTTPStatus, str, str, Mapping[str, str]]
"""Status, content type, content and headers of a response."""
_THIN = 4  # the page gets every fourth viewing geometry, for what it says under the pointer


def serve(mission: Mission, *, port: int, say: Callable[[str], None], browser: bool = True) -> None:
    """Serve the page until Ctrl-C, and open it in a browser; the sliders start at the mission.

    Port 0 selects a free one; `say` is called with each line to show, such as the address of the page.

    Raises InputError: the port is taken.
    """
    server = make_server(mission, port)
    answer(mission, {})  # the first drawing loads what draws; no one need wait for it
    url = f"http://{ADDRESS}:{server.server_address[1]}/"
    say(f"the plan is at {url}, for this machine only. Ctrl-C ends it.")
    if browser:
        import webbrowser

        webbrowser.open(url)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        say("ended.")
    finally:
        server.server_close()


def make_server(mission: Mission, port: int = 0) -> ThreadingHTTPServer:
    """The server, bound to the loopback address and not yet serving.

    Raises InputError: the port is taken.
    """
    try:
        return _Server(mission, port)
    except OSError as error:
        raise InputError(f"port {port} cannot be had: {error.strerror}. Give another --port, or 0.") from error


class _Server(ThreadingHTTPServer):
    """A server with a long queue of connections."""

    request_queue_size = 128
    daemon_threads = True

    def __init__(self, mission: Mission, port: int) -> None:
        super().__init__((ADDRESS, port), _Handler)
        self.mission, self.drawing = mission, threading.BoundedSemaphore(PLANS_AT_ONCE)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that closed the connection."""
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Serves the page at GET / and a plan at GET /plan?..."""

    server: _Server
    protocol_version = "HTTP/1.1"
    server_version = "deglint"
    sys_version = ""
    timeout = 60

    def do_GET(self) -> None:
        """Respond if the request is for this machine; a closed connection is not an error."""
        try:
            self._send(*self._answer())
        except (ConnectionError, TimeoutError):
            self.close_connection = True

    def _answer(self) -> Answer:
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return HTTPStatus.FORBIDDEN, "text/plain", "this page is not for other sites\n", {}
        # Host names the loopback address, so that no other site's name can be pointed here
        if self.headers.get("Host", "") not in (f"{host}:{self.server.server_port}" for host in (ADDRESS, "localhost")):
            return HTTPStatus.MISDIRECTED_REQUEST, "text/plain", "this page is for this machine only\n", {}
        parts = urlsplit(self.path)
        if parts.path == "/":
            return self._page()
        if parts.path == "/plan":
            return self._plan({name: values[-1] for name, values in parse_qs(parts.query).items()})
        return HTTPStatus.NOT_FOUND, "text/plain", "there is / and /plan\n", {}

    def _page(self) -> Answer:
        nonce = secrets.token_urlsafe(16)
        text = resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")
        start = json.dumps(_start(self.server.mission)).replace("<", "\\u003c")
        text = text.replace("{{nonce}}", nonce).replace("{{start}}", start)
        policy = (
            f"default-src 'none'; img-src data:; connect-src 'self'; style-src 'nonce-{nonce}';"
            f" script-src 'nonce-{nonce}'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        return HTTPStatus.OK, "text/html; charset=utf-8", text, {"Content-Security-Policy": policy}

    def _plan(self, asked: Mapping[str, str]) -> Answer:
        if not self.server.drawing.acquire(timeout=WAIT):
            self.close_connection = True
            busy = json.dumps({"error": f"busy: {PLANS_AT_ONCE} plans are drawn at a time. Try again."})
            return HTTPStatus.SERVICE_UNAVAILABLE, "application/json", busy, {"Retry-After": f"{WAIT:.0f}"}
        try:
            return HTTPStatus.OK, "application/json", json.dumps(answer(self.server.mission, asked)), {}
        except DeglintError as error:
            return HTTPStatus.BAD_REQUEST, "application/json", json.dumps({"error": str(error)}), {}
        finally:
            self.server.drawing.release()

    def _send(self, status: HTTPStatus, kind: str, text: str, headers: Mapping[str, str]) -> None:
        body = text.encode()
        self.send_response(status)
        fixed = {"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
                 "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
                 "Cross-Origin-Resource-Policy": "same-origin"}  # fmt: skip
        for name, value in {**fixed, **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  (the name that the base class gives it)
        """Do not log single requests."""


def answer(base: Mission, asked: Mapping[str, str]) -> dict[str, Any]:
    """The plan for a request: picture, text, and the viewing geometries for the pointer.

    `asked` has the values of the sliders by name; others are those of `base`.

    Raises InputError: a value cannot be used, or the sun is down.
    """
    tables: dict[str, dict[str, Any]] = {"place": {"time": asked["time"]}} if "time" in asked else {}
    for name in asked.keys() - {"time", "sensor", "band"}:
        if name not in _PAGE_NUMBERS:
            known = f"{', '.join(_PAGE_NUMBERS)}, time, sensor, band"
            raise InputError(f"there is no {name[:40]!r} to set; there are {known}.")
        table, key = _PAGE_NUMBERS[name]
        try:
            tables.setdefault(table, {})[key] = float(asked[name])
        except ValueError:
            raise InputError(f"{name} must be a number, got {asked[name][:40]!r}.") from None
    given = tables_of(base)
    if base.air is None:  # it follows from wind, place and time, so it follows the sliders
        del given["air"], given["wind"]["mean"]
    mission = mission_from(merged(given, tables), "the page")
    sensor = asked.get("sensor", base.sensor.name)
    if sensor != base.sensor.name:
        if sensor not in PRESETS:
            raise InputError(f"sensor must be one of {', '.join(PRESETS)}, got {sensor[:40]!r}. Choose one of these.")
        mission = replace(mission, sensor=PRESETS[sensor], bands=())
    plan = reticle(mission)
    band = asked.get("band") or None
    return {
        "picture": base64.b64encode(png(picture(plan, band=band))).decode(),
        "words": description(best_geometry(plan, band=band)),
        "bands": list(plan.bands),
        "pointer": _pointer(plan),
    }


def _start(base: Mission) -> dict[str, Any]:
    """Initial values of the page."""
    tables = tables_of(base)
    values = {name: tables.get(table, {}).get(key) for name, (table, key) in _PAGE_NUMBERS.items()}
    time = None if base.sun_zenith is not None else f"{base.moment}"[:16]
    sensors = [base.sensor.name, *(name for name in PRESETS if name != base.sensor.name)]
    frame = {"width": WIDTH, "height": HEIGHT, "x": DISC_CENTRE[0], "y": DISC_CENTRE[1], "radius": DISC_RADIUS}
    return {"values": values, "time": time, "sensors": sensors, "sensor": base.sensor.name, "frame": frame,
            "strongest": base.strongest_wind}  # fmt: skip


def _pointer(plan: Reticle) -> dict[str, Any]:
    contrast, glint = (layer[::_THIN, ::_THIN] for layer in (plan.combined, plan.glint_probability))
    return {
        "widest": plan.mission.widest,
        "contrast": np.rint(contrast).astype(int).tolist(),
        "glint": np.log10(np.maximum(glint, 1e-12)).round(1).tolist(),
    }
