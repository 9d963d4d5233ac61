"""A local web page with sliders: the plan is redrawn when a value changes, such as wind, time, place or depth.

The server is bound to the loopback address, so only this machine can reach it. It rejects requests that name another
host, because a foreign web page can make a browser send them. The page loads nothing from other servers.
"""

import base64
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from ..checks import check_choice
from ..errors import DeglintError, InputError
from ..physics.presets import PRESETS
from .draw import png
from .mission import Mission
from .picture import DISC_CENTRE, DISC_RADIUS, HEIGHT, WIDTH, picture
from .reticle import best_geometry, description, reticle

ADDRESS = "127.0.0.1"  # the loopback address
_PLACE_OR_SUN = ("latitude", "longitude", "sun_zenith", "sun_azimuth")
SLIDERS = (*_PLACE_OR_SUN, "wind", "wind_from", "depth", "reflectance", "chlorophyll")
"""Fields of `Mission` with a slider; the page also changes visibility, the limit of glint, time, sensor and band."""
_POLICY = (  # the page may load nothing but plans from this server
    "default-src 'none'; img-src data:; connect-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline';"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_THIN = 4  # the page gets about every fourth viewing geometry, ends included, for values at the mouse pointer


def serve(mission: Mission, *, port: int, say: Callable[[str], None], browser: bool = True) -> None:
    """Serve the page until Ctrl-C and, if `browser`, open it in a browser; sliders start at the values of `mission`.

    Port 0 selects a free port. `say` is called with each line of text to show, such as the address of the page.
    Raises InputError if the port cannot be used.
    """
    server = make_server(mission, port)
    answer(mission, {})  # loads all modules that a plan needs, so that the first request is fast
    url = f"http://{ADDRESS}:{server.server_port}/"
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
    """Make the server, bound to the loopback address, not yet serving. Raises InputError if the port cannot be used."""
    try:
        return _Server(mission, port)
    except OSError as error:
        raise InputError(f"port {port} is not available: {error.strerror}. Give another --port, or 0.") from error


class _Server(ThreadingHTTPServer):
    def __init__(self, mission: Mission, port: int) -> None:
        super().__init__((ADDRESS, port), _Handler)
        self.mission = mission

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error in a request, but not if the client closed the connection."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Handler of HTTP requests: `GET /` returns the page, `GET /plan?...` a plan as JSON."""

    server: _Server

    def do_GET(self) -> None:
        """Answer a GET request; reject it if it names another host or comes from a page of another site."""
        hosts = [f"{host}:{self.server.server_port}" for host in (ADDRESS, "localhost")]
        parts = urlsplit(self.path)
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            self._send(HTTPStatus.FORBIDDEN, "text/plain", "this page is not for other sites\n")
        elif self.headers.get("Host") not in hosts:  # else another site's name could resolve to this address
            self._send(HTTPStatus.MISDIRECTED_REQUEST, "text/plain", "this page is for this machine only\n")
        elif parts.path == "/":
            text = resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")
            start = json.dumps(_start(self.server.mission)).replace("<", "\\u003c")
            self._send(HTTPStatus.OK, "text/html; charset=utf-8", text.replace("{{start}}", start))
        elif parts.path == "/plan":
            try:
                status, found = HTTPStatus.OK, answer(self.server.mission, dict(parse_qsl(parts.query)))
            except (DeglintError, ValueError) as error:
                status, found = HTTPStatus.BAD_REQUEST, {"error": str(error)}
            self._send(status, "application/json", json.dumps(found))
        else:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", "there is / and /plan\n")

    def _send(self, status: HTTPStatus, kind: str, text: str) -> None:
        body = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002  (the name that the base class gives it)
        """Log nothing, whereas the base class logs each request."""


def answer(base: Mission, asked: Mapping[str, str]) -> dict[str, object]:
    """Compute a plan for the page: picture (PNG in base64), text, names of bands, values to show at the mouse pointer.

    `asked` holds the changed values by name, as text; all other values are taken from `base`.
    Raises InputError or ValueError if a value cannot be used or the sun is down.
    """
    numbers: dict[str, Any] = {name: float(asked[name]) for name in SLIDERS if name in asked}
    limits = replace(base.limits, glint=float(asked.get("glint", base.limits.glint)))
    mission = replace(base, limits=limits, time=asked.get("time", base.time), **numbers)
    if "visibility" in asked:  # `weather` is the air of `base`, or else the default for the new place and time
        mission = replace(mission, air=replace(mission.weather, visibility=float(asked["visibility"])))
    sensor = asked.get("sensor", base.sensor.name)
    if sensor != base.sensor.name:
        check_choice(sensor, list(PRESETS), "sensor")
        mission = replace(mission, sensor=PRESETS[sensor], bands=())
    plan = reticle(mission)
    band = asked.get("band") or None
    thin = np.ix_(*(np.rint(np.linspace(0, n - 1, -(-(n - 1) // _THIN) + 1)).astype(int) for n in plan.combined.shape))
    return {
        "picture": base64.b64encode(png(picture(plan, band=band))).decode(),
        "words": description(best_geometry(plan, band=band)),
        "bands": list(plan.bands),
        "pointer": {
            "widest": plan.mission.widest,
            "contrast": np.rint(plan.combined[thin]).astype(int).tolist(),
            "glint": np.log10(np.maximum(plan.glint_probability[thin], 1e-12)).round(1).tolist(),
        },
    }


def _start(base: Mission) -> dict[str, object]:
    """Initial state of the page, for JSON: values of the sliders, largest wind, time, sensors, size of the picture."""
    values = {name: getattr(base, name) for name in SLIDERS}
    values |= {"visibility": base.weather.visibility, "glint": base.limits.glint}
    time = None if base.sun_zenith is not None else f"{base.moment}"[:16]
    sensors = [base.sensor.name, *(name for name in PRESETS if name != base.sensor.name)]
    frame = {"width": WIDTH, "height": HEIGHT, "x": DISC_CENTRE[0], "y": DISC_CENTRE[1], "radius": DISC_RADIUS}
    start = {"values": values, "time": time, "sensors": sensors, "sensor": base.sensor.name}
    return start | {"frame": frame, "strongest": base.strongest_wind}
