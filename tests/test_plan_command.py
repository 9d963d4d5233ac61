"""`deglint plan` as a newcomer types it: what it writes, what it says, how it refuses."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.warp import transform

from deglint.cli import plan as command
from deglint.cli.options import ChoiceFromTable
from deglint.physics import sky, slopes
from deglint.physics.presets import PRESETS
from deglint.plan.mission import WATERS

from .common import says

PLACE = ("--lat", "36.8", "--lon", "-122", "--time", "2026-06-21T18:00Z")
WIND = ("--wind", "7@310")


def test_names_in_help_are_those_there_are():
    choices = {p.name: p.type.choices for p in command.plan.params if isinstance(p.type, ChoiceFromTable)}
    assert choices == {"slopes": tuple(slopes.MODELS), "sky": sky.SKY_MODELS, "sensor": tuple(PRESETS), "water": WATERS}


def test_the_command_of_the_readme(deglint, tmp_path):
    out = tmp_path / "plan.png"
    ran = deglint("plan", *PLACE, *WIND, "-o", out)
    assert ran.code == 0
    assert ran.err == ""
    assert ran.out.startswith("Look from the east-north-east (azimuth 07")
    import cv2

    assert cv2.imread(str(out)).shape == (860, 1240, 3)
    again = deglint("plan", *PLACE, *WIND, "-o", out)
    assert again.code == 1
    assert "exists already. Give --overwrite" in again.err


def test_every_format_says_the_same(deglint, tmp_path):
    xarray = pytest.importorskip("xarray")
    outs = [tmp_path / f"plan{ending}" for ending in (".json", ".nc", ".tif")]
    options = [x for out in outs for x in ("-o", out)]
    assert deglint("plan", *PLACE, *WIND, "--step", "2", *options).code == 0
    document = json.loads(outs[0].read_text())
    with xarray.open_dataset(outs[1], engine="scipy") as data:
        assert data.sizes == {"band": 8, "zenith": 41, "azimuth": 181}
        assert data["snr"].attrs["units"] == "1"
        assert data["glint_radiance"].attrs["units"] == "W m-2 sr-1 nm-1"
        with rasterio.open(outs[2]) as tif:
            assert tif.transform * (0.5, 0.5) == (0.0, 0.0)
            assert tif.transform * (180.5, 40.5) == (360.0, 80.0)
            for k, name in enumerate(tif.descriptions, start=1):
                layer, _, band = name.partition(" ")
                wanted = data[layer].sel(band=band) if band else data[layer]
                np.testing.assert_array_equal(tif.read(k), wanted.values.astype(np.float32))
        layers = document["layers"]
        assert set(layers) - set(data) == {"sky_strength"}
        for name in set(layers) & set(data):
            np.testing.assert_allclose(np.array(layers[name]["values"]), data[name], rtol=6e-4, atol=1e-29)
        best = document["best"]
        here = data.sel(zenith=best["zenith"], azimuth=best["azimuth"])
        assert float(here["combined"]) == pytest.approx(best["contrast"], rel=1e-5)
        assert document["words"] == data.attrs["words"]
    assert set(best["bands"][0]["electrons"]) == {"background", "object", "sky", "glint"}


def test_json_on_stdout_and_nothing_else(deglint):
    ran = deglint("plan", "--sun", "20.5@270.2", "--wind", "9@0", "--json", "--step", "5", "-q")
    found = json.loads(ran.out)
    assert found["sun"] == {"zenith": 20.5, "azimuth": 270.2}
    assert found["mission"]["wind"]["speed"] == 9.0


def test_without_xarray_netcdf_names_the_extra(deglint, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    ran = deglint("plan", *PLACE, *WIND, "--step", "10", "-o", tmp_path / "a.png", "-o", tmp_path / "a.nc")
    assert ran.code == 1
    assert "pip install 'deglint[xarray]'" in ran.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--lat", "36.8", "--lon", "-122", "--time", "2026-06-21T08:00Z"), 1, "1 degree high at 2026-06-21T12:58Z"),
        ((*PLACE, "--wind", "30@0"), 1, "wind ... 0.1 to 19.6 m/s ... 30"),
        ((*PLACE, "--wind", "fast"), 2, "'fast' is not like 7@310"),
        ((*PLACE, "--depth", "-2"), 1, "depth ... 0 to 1000 m ... -2"),
        ((*PLACE, "--sensor", "hubble"), 2, "'hubble' is not one of ... worldview3"),
        ((*PLACE, "--show", "purple"), 1, "no band 'purple' in thesis; it has COASTAL"),
        ((*PLACE, "--band", "BLUE,PURPLE"), 1, "no band 'PURPLE'"),
        ((*PLACE, "--pressure", "30 inches"), 1, "pressure must be like 1013 hPa"),
        ((), 1, "sun ... give latitude and longitude"),
        (("--lat", "36.8"), 1, "give latitude and longitude"),
        (("--lat", "136", "--lon", "0"), 1, "latitude ... -90 to 90 degrees ... 136"),
        (("--lat", "0", "--lon", "0", "--time", "noon"), 1, "time ... like 2026-06-21T18:00Z ... 'noon'"),
        ((*PLACE, "--sun", "20@30"), 2, "--sun ... not both"),
        (("--sun", "20@30", "--lon", "5"), 2, "--sun ... not both"),
        (("--sun", "20@30", "--pitch", "10"), 2, "--pitch is for --fov"),
        ((*PLACE, "--altitude", "99"), 2, "--altitude is for --fov"),
        ((*PLACE, "--port", "1"), 2, "--port is for --serve"),
        ((*PLACE, "--fov", "40", "--no-browser"), 2, "--no-browser is for --serve"),
        (("--sun", "20"), 2, "--sun needs zenith angle and azimuth"),
        (("--mission", "nowhere.toml"), 1, "no such file: nowhere.toml"),
        ((*PLACE, "-o", "plan.docx"), 1, "plan.docx ... .png, .json, .nc, .tif"),
        ((*PLACE, "-o", "/nonexistent/plan.png"), 1, "/nonexistent does not exist"),
        ((*PLACE, "--fov", "wide"), 2, "'wide' is not ACROSS"),
        ((*PLACE, "--fov", "40", "--wind-within", "2"), 2, "--wind-within and --fov"),
        ((*PLACE, "--from", "2026-06-21T13:00Z"), 2, "needs both --from and --to"),
        ((*PLACE, "--serve", "-o", "x.png"), 2, "--serve writes no files"),
        ((*PLACE, "--every", "soon", "--from", "x", "--to", "y"), 2, "'soon' is not like 30min or 1h"),
    ],
)
def test_refusals_are_one_line_with_the_remedy(deglint, arguments, code, said):
    ran = deglint("plan", *arguments)
    assert ran.code == code
    assert says(ran.err, *said.split(" ... "))
    assert ran.out == ""
    assert len([line for line in ran.err.splitlines() if line.startswith("Error")]) == 1


def test_a_mission_whose_place_is_no_table_is_one_line(deglint, tmp_path):
    (tmp_path / "m.toml").write_text("place = 3")
    ran = deglint("plan", "--mission", tmp_path / "m.toml")
    assert ran.code == 1
    assert "m.toml: place must be a table" in ran.err


def test_what_is_assumed_is_said(deglint):
    ran = deglint("plan", "--lat", "36.8", "--lon", "-122", "--time", "2026-06-21T18:00", "--step", "10")
    assert ran.code == 0
    assert says(ran.err, "2026-06-21T18:00 ", "no time zone", "UTC")
    assert says(ran.err, "wind: 5 m/s from 0 degrees", "--wind SPEED@FROM")
    strong = deglint("plan", *PLACE, "--wind", "16@0", "--step", "10")
    assert "extrapolated beyond 14 m/s" in strong.err
    zone = deglint("plan", "--lat", "0", "--lon", "0", "--time", "2026-06-21T14:00+02:00", *WIND, "--step", "10")
    assert zone.err == ""
    span = ("--from", "2026-06-21T15:00", "--to", "2026-06-21T16:00Z", "--every", "1h")
    swept = deglint("plan", *PLACE[:4], *WIND, *span)
    assert (swept.err.count("\n"), says(swept.err, "2026-06-21T15:00 ", "no time zone", "UTC")) == (1, True)


def test_a_mission_file_and_options_over_it(deglint, tmp_path):
    file = tmp_path / "survey.toml"
    file.write_text(
        "[place]\nlatitude = 36.8\nlongitude = -122\ntime = 2026-06-21T18:00:00Z\n"
        '[wind]\nspeed = 7\nfrom = 310\n[air]\npressure = "29.92 inHg"\nvisibility = 20\n'
        '[sensor]\npreset = "worldview3"\nbands = ["BLUE", "GREEN"]\n[limits]\nglint = 5e-4\n[look]\nstep = 5\n'
    )
    ran = deglint("plan", "--mission", file, "--depth", "8", "--wind", "4", "--json")
    assert ran.code == 0
    found = json.loads(ran.out)["mission"]
    assert found["wind"]["speed"] == 4.0
    assert found["wind"]["from"] == 310.0
    assert found["object"]["depth"] == 8.0
    assert found["air"]["pressure"] == pytest.approx(1013.2, abs=0.1)
    assert [b["name"] for b in found["sensor"]["band"]] == ["BLUE", "GREEN"]
    file.write_text("[sun]\nzenith = 30\nazimuth = 100\n[look]\nstep = 10\n")
    assert "wind: 5 m/s" in deglint("plan", "--mission", file).err
    file.write_text("[wind\n")
    assert "is not TOML" in deglint("plan", "--mission", file).err


def test_place_from_a_raster_and_from_geojson(deglint, tmp_path, write, sea, geojson):
    scene = write(tmp_path / "sea.tif", sea())
    with rasterio.open(scene) as dataset:
        x, y = dataset.transform * (50, 40)
        (lon,), (lat,) = transform(dataset.crs, "EPSG:4326", [x], [y])
    options = ("--time", "2026-06-21T02:00Z", *WIND, "--step", "10", "--json")
    found = json.loads(deglint("plan", "--place", scene, *options).out)["mission"]["place"]
    assert (found["latitude"], found["longitude"]) == pytest.approx((lat, lon), abs=1e-9)
    area = geojson(tmp_path / "area.geojson", [(10, 40), (14, 40), (14, 44), (10, 44)])
    found = json.loads(deglint("plan", "--place", area, "--time", "2026-06-21T10:00Z", *options[2:]).out)
    assert found["mission"]["place"]["latitude"] == pytest.approx(42.0)
    assert found["mission"]["place"]["longitude"] == pytest.approx(12.0)
    (tmp_path / "empty.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    assert "holds no point" in deglint("plan", "--place", tmp_path / "empty.geojson", *options).err
    bare = write(tmp_path / "bare.tif", sea(), crs=None)
    assert "has no CRS" in deglint("plan", "--place", bare, *options).err
    nowhere = write(tmp_path / "nowhere.tif", sea(), crs="EPSG:4326", transform=None)
    assert "has no CRS or geotransform" in deglint("plan", "--place", nowhere, *options).err
    assert deglint("plan", "--place", scene, "--lat", "3", *options).code == 2


def test_a_sweep_has_a_line_for_each_time(deglint, tmp_path):
    span = ("--from", "2026-06-21T11:00Z", "--to", "2026-06-21T20:00Z", "--every", "3h")
    outs = (tmp_path / "day.png", tmp_path / "day.json")
    ran = deglint("plan", *PLACE[:4], *WIND, *span, "-o", outs[0], "-o", outs[1])
    assert ran.code == 0
    assert len(ran.out.splitlines()) == 5
    found = json.loads(outs[1].read_text())
    assert [m["time"][11:16] for m in found["moments"]] == ["11:00", "14:00", "17:00", "20:00"]
    assert found["best"] == max((m for m in found["moments"] if m["geometry"]), key=lambda m: m["geometry"]["contrast"])
    assert "time" not in found["mission"]["place"]
    night = deglint("plan", *PLACE[:4], *WIND, "--from", "2026-06-21T07:00Z", "--to", "2026-06-21T09:00Z")
    assert night.code == 1
    assert says(night.err, "sun is below the horizon", "choose that or a later time")


@pytest.mark.slow
def test_an_uncertain_wind_and_a_flight_line(deglint, tmp_path):
    ran = deglint("plan", *PLACE, *WIND, "--wind-within", "2@30", "--step", "5", "-o", tmp_path / "a.png", "--json")
    found = json.loads(ran.out)
    low, high = found["best"]["intervals"]["contrast"]
    assert 0 < low <= high
    ran = deglint("plan", *PLACE, *WIND, "--fov", "20x10", "--roll", "40", "-o", tmp_path / "b.png")
    assert ran.out.startswith("Fly heading ")
    assert {p.name for p in tmp_path.iterdir()} == {"a.png", "b.png"}


def test_a_page_without_a_time_starts_by_day(deglint, monkeypatch, tmp_path):
    started = []
    monkeypatch.setattr("deglint.plan.serve.serve", lambda mission, **_: started.append(mission))
    for longitude in ("-122", "58"):  # it is night at one of them, or nearly so
        ran = deglint("plan", "--lat", "36.8", "--lon", longitude, "--serve")
        assert ran.code == 0
        assert "the next daylight" in ran.err
    assert all(mission.sun[0] < 80 for mission in started)
    assert deglint("plan", *PLACE, "--serve").err == ""
    (tmp_path / "m.toml").write_text('[place]\nlatitude = 36.8\nlongitude = -122.0\ntime = "2026-06-21T18:00Z"\n')
    assert deglint("plan", "--mission", tmp_path / "m.toml", "--serve").err == ""
    assert str(started[-1].moment) == "2026-06-21T18:00:00"


def test_a_heading_in_glint_comes_with_what_else_to_do(deglint):
    noon = ("--lat", "20", "--lon", "-157", "--time", "2026-06-21T22:00Z", *WIND, "--fov", "40")
    found = json.loads(deglint("plan", *noon, "--json").out)
    assert found["best"]["fraction"] == 1.0
    time, tilt = found["alternatives"]
    assert time["fraction"] < 0.02
    assert time["time"].startswith("2026-06-21T")
    assert tilt["pitch"] or tilt["roll"]
    assert "Another time: at 2026-06-21 " in found["words"]
    assert deglint("plan", *noon).out.splitlines() == found["words"].replace(". A", ".\nA").splitlines()


def test_help_is_quick_and_loads_no_planner():
    code = "import sys, deglint.cli.plan\nassert not {'numpy', 'deglint.plan', 'pvlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ}, cwd=Path(__file__).parents[1])
