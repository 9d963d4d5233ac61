"""Rasters from strangers: they read nothing outside their own folder, and take no more time than they may."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from deglint.errors import InputError, ReadError
from deglint.raster.files import MOST_NESTED, TRUST
from deglint.raster.info import open_dataset
from deglint.readers.text import read_text

RUN = ("--method", "hedley", "--sample", "all", "--mask", "none", "--nir", "4")
SECRET = "the secret of another folder"


def vrt(path, source, *, relative=0, rows=80, columns=100, times=1, more=""):
    one = "".join(
        f'<SimpleSource><SourceFilename relativeToVRT="{relative}">{source}</SourceFilename><SourceBand>{{0}}'
        "</SourceBand></SimpleSource>" for _ in range(times)
    )  # fmt: skip
    bands = "".join(
        f'<VRTRasterBand dataType="UInt16" band="{b}">{one.format(b)}</VRTRasterBand>' for b in (1, 2, 3, 4)
    )
    path.write_text(f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}">{bands}{more}</VRTDataset>')
    return path


def raw(path, source, relative=0):
    path.write_text(
        '<VRTDataset rasterXSize="7" rasterYSize="4"><VRTRasterBand dataType="Byte" band="1" '
        f'subClass="VRTRawRasterBand"><SourceFilename relativeToVRT="{relative}">{source}</SourceFilename>'
        "<ImageOffset>0</ImageOffset><PixelOffset>1</PixelOffset><LineOffset>7</LineOffset></VRTRasterBand></VRTDataset>"
    )
    return path


@pytest.fixture
def folders(sea, write, tmp_path):
    """A folder of a stranger's scene, and one that is none of its business."""
    theirs, ours = tmp_path / "theirs", tmp_path / "ours"
    for folder in (theirs, ours, theirs / "parts"):
        folder.mkdir()
    (ours / "secret").write_text(SECRET)
    write(ours / "ours.tif", sea())
    write(theirs / "in.tif", sea())
    write(theirs / "parts" / "in.tif", sea())
    (theirs / "link.tif").symlink_to(ours / "ours.tif")
    return theirs, ours


OUTSIDE = {
    "raw": lambda t, o: raw(t / "a.vrt", o / "secret"),
    "raw, relative": lambda t, o: raw(t / "a.vrt", "../ours/secret", 1),
    "absolute": lambda t, o: vrt(t / "a.vrt", o / "ours.tif"),
    "relative": lambda t, o: vrt(t / "a.vrt", "../ours/ours.tif", relative=1),
    "a link": lambda t, o: vrt(t / "a.vrt", "link.tif", relative=1),
    "nested": lambda t, o: (raw(t / "b.vrt", o / "secret"), vrt(t / "a.vrt", "b.vrt", relative=1))[1],
    "nested in XML": lambda t, o: vrt(
        t / "a.vrt", vrt(t / "b.vrt", o / "ours.tif").read_text().replace("<", "&lt;").replace('"', "&quot;")
    ),
    "vrt://": lambda t, o: vrt(t / "a.vrt", f"vrt://{o / 'ours.tif'}?bands=1"),
    "a warp": lambda t, o: warped(t / "a.vrt", o / "ours.tif"),
    "an archive": lambda t, o: vrt(t / "a.vrt", f"/vsizip/{o / 'ours.tif'}/x.tif"),
    "a part of a file": lambda t, o: vrt(t / "a.vrt", f"/vsisubfile/0_100,{o / 'ours.tif'}"),
    "a subdataset": lambda t, o: vrt(t / "a.vrt", f"GTIFF_DIR:1:{o / 'ours.tif'}"),
    "a server": lambda t, o: vrt(t / "a.vrt", "/vsicurl/http://127.0.0.1:9/a.tif"),
    "a server's address": lambda t, o: vrt(t / "a.vrt", "http://127.0.0.1:9/a.tif"),
    "a database": lambda t, o: vrt(t / "a.vrt", "PG:dbname=x"),
    "case": lambda t, o: case(t / "a.vrt", o / "ours.tif"),
    "a child": lambda t, o: child(t / "a.vrt"),
}


def warped(path, source):
    path.write_text(
        '<VRTDataset rasterXSize="100" rasterYSize="80" subClass="VRTWarpedDataset"><VRTRasterBand dataType="UInt16" '
        'band="1" subClass="VRTWarpedRasterBand"/><GDALWarpOptions>'
        f'<SourceDataset relativeToVRT="0">{source}</SourceDataset></GDALWarpOptions></VRTDataset>'
    )
    return path


def case(path, source):
    text = vrt(path, source).read_text()
    path.write_text(text.replace("SourceFilename", "SOURCEfilename"))
    return path


def child(path):
    """The flag may be an element, too."""
    text = vrt(path, "../ours/ours.tif").read_text()
    text = text.replace(' relativeToVRT="0"', "").replace(
        "</SourceFile", "<relativeToVRT>1</relativeToVRT></SourceFile"
    )
    path.write_text(text)
    return path


@pytest.mark.parametrize("how", OUTSIDE)
def test_nothing_outside_its_folder_is_read(deglint, folders, monkeypatch, how):
    theirs, ours = folders
    monkeypatch.chdir(theirs)
    path = OUTSIDE[how](theirs, ours)
    ran = deglint("remove", path, theirs / "out.tif", *RUN)
    assert ran.code == 1
    assert "DEGLINT_VRT" in ran.err
    assert not (theirs / "out.tif").exists()
    assert deglint("info", path).code == 1
    assert deglint("remove", theirs / "in.tif", theirs / "out.tif", *RUN, "--mask", path).code == 1


@pytest.mark.parametrize("allowed", ["any", "{ours}", "/nowhere:{ours}"])
@pytest.mark.parametrize("how", ["raw", "absolute", "relative", "a link"])
def test_what_the_user_allows_is_read(folders, monkeypatch, how, allowed):
    theirs, ours = folders
    monkeypatch.setenv(TRUST, allowed.format(ours=ours))
    with open_dataset(str(OUTSIDE[how](theirs, ours))) as dataset:
        assert how != "raw" or bytes(dataset.read(1)).decode() == SECRET
    monkeypatch.setenv(TRUST, str(theirs))
    with pytest.raises(InputError):
        open_dataset(str(OUTSIDE[how](theirs, ours)))


@pytest.mark.parametrize("source", ["in.tif", "parts/in.tif", "{theirs}/in.tif", "./parts/../in.tif"])
def test_what_lies_in_its_folder_is_read(folders, monkeypatch, read, source):
    theirs, _ = folders
    monkeypatch.chdir(theirs.parent)
    path = vrt(theirs / "a.vrt", source.format(theirs=theirs), relative=int(not source.startswith("{")))
    with open_dataset("theirs/a.vrt") as dataset:
        np.testing.assert_array_equal(dataset.read(), read(theirs / "in.tif"))
    assert path.exists()


def test_a_vrt_in_an_archive_reads_its_archive(folders, monkeypatch):
    import zipfile

    theirs, ours = folders
    vrt(theirs / "a.vrt", "in.tif", relative=1)
    vrt(theirs / "b.vrt", ours / "ours.tif")
    with zipfile.ZipFile(theirs / "z.zip", "w") as archive:
        for name in ("in.tif", "a.vrt", "b.vrt"):
            archive.write(theirs / name, f"d/{name}")
    open_dataset(f"/vsizip/{theirs}/z.zip/d/a.vrt").close()
    with pytest.raises(InputError, match="not in that folder"):
        open_dataset(f"/vsizip/{theirs}/z.zip/d/b.vrt")


def test_a_header_of_another_format_leads_nowhere_else(folders):
    """A PDS label may name the file of its pixels, as other formats may."""
    theirs, ours = folders
    lines = ["PDS_VERSION_ID = PDS3", "RECORD_TYPE = FIXED_LENGTH", "RECORD_BYTES = 7", "FILE_RECORDS = 4",
             f'^IMAGE = "{ours / "secret"}"', "OBJECT = IMAGE", "LINES = 4", "LINE_SAMPLES = 7",
             "SAMPLE_TYPE = UNSIGNED_INTEGER", "SAMPLE_BITS = 8", "END_OBJECT = IMAGE", "END"]  # fmt: skip
    (theirs / "a.lbl").write_text("\r\n".join(lines) + "\r\n")
    with pytest.raises((InputError, ReadError)):
        open_dataset(str(theirs / "a.lbl")).close()


@pytest.mark.parametrize(
    "text", ['<!DOCTYPE x [<!ENTITY y "z">]>', "<VRTDataset", "<VRTDataset><a></VRTDataset>", "<VRTDataset>" * 3000]
)
def test_damaged_xml_is_one_line(deglint, tmp_path, text):
    (tmp_path / "a.vrt").write_text(text + "<VRTDataset></VRTDataset>")
    ran = deglint("info", tmp_path / "a.vrt")
    assert ran.code == 1
    assert "damaged" in ran.err
    assert ran.err.count("\n") == 1


def test_a_source_whose_name_is_not_text(deglint, folders):
    theirs, _ = folders
    path = vrt(theirs / "a.vrt", "in.tif", relative=1)
    for text in (b"parts/\xff/in.tif", b"\xe9.tif"):
        path.write_bytes(path.read_bytes().replace(b"in.tif", text, 1))
        ran = deglint("info", path)
        assert ran.code == 1
        assert "not UTF-8" in ran.err
    path = vrt(theirs / "b.vrt", "in.tif", relative=1, more="<Metadata><MDI key='a'>5\xb0</MDI></Metadata>")
    path.write_bytes(path.read_text().encode("latin-1"))
    open_dataset(str(path)).close()


def test_mosaics_of_mosaics_are_counted(deglint, folders):
    theirs, _ = folders
    source = "in.tif"
    for i in range(11):
        source = vrt(theirs / f"{i}.vrt", source, relative=1, times=12).name
    ran = deglint("info", theirs / source)
    assert ran.code == 1
    assert "reads 743,008,370,688 sources for a band" in ran.err
    for i in range(MOST_NESTED + 2):
        source = vrt(theirs / f"d{i}.vrt", source if i else "in.tif", relative=1).name
    assert "deep" in deglint("info", theirs / source).err


def test_a_flat_mosaic_of_many_files_is_no_such_thing(tmp_path, monkeypatch):
    monkeypatch.setattr("deglint.raster.files.MOST_READS", 10)
    sources = "".join(
        f'<SimpleSource><SourceFilename relativeToVRT="1">{i}.tif</SourceFilename></SimpleSource>' for i in range(50)
    )
    text = f'<VRTRasterBand dataType="Byte" band="1">{sources}</VRTRasterBand>'
    (tmp_path / "a.vrt").write_text(f'<VRTDataset rasterXSize="9" rasterYSize="9">{text}</VRTDataset>')
    open_dataset(str(tmp_path / "a.vrt")).close()


def test_a_pipe_is_no_file(deglint, sea, write, tmp_path):
    os.mkfifo(tmp_path / "p.tif")
    os.mkfifo(tmp_path / "p.json")
    source = write(tmp_path / "in.tif", sea())
    pipe, text = tmp_path / "p.tif", tmp_path / "p.json"
    over = vrt(tmp_path / "v.vrt", "p.tif", relative=1)
    for arguments in (["info", pipe], ["remove", pipe, tmp_path / "o.tif"], ["info", over],
                      ["remove", source, tmp_path / "o.tif", "--mask", pipe], ["info", "/vsistdin/"],
                      ["remove", source, tmp_path / "o.tif", "--sample", text], ["plan", "--mission", text],
                      ["remove", source, tmp_path / "o.tif", "--model", text], ["info", source, pipe]):  # fmt: skip
        ran = deglint(*arguments)
        assert ran.code == 1, arguments
        assert "is a pipe" in ran.err
    with pytest.raises(ReadError, match="is a device"):
        read_text("/dev/zero", "--sample")


def test_a_look_ends_where_its_time_is_over(deglint, folders, monkeypatch):
    """Nearly all of it is empty, so that a look for water would read it all."""
    theirs, _ = folders
    monkeypatch.setenv("DEGLINT_INFO_SECONDS", "1")
    path = vrt(theirs / "a.vrt", "in.tif", relative=1, rows=10**6, columns=10**6)
    ran = deglint("info", path, "--nir", "4", "--json")
    assert ran.code == 0
    assert "what lies in the others is not known" in json.loads(ran.out)["reason"]
    monkeypatch.delenv("DEGLINT_INFO_SECONDS")
    monkeypatch.setattr("deglint.pipeline.fit.LOOK_READS", 3)
    assert "stopped after 60 s or 3 windows: 3 windows" in deglint("info", path, "--nir", "4").out


@pytest.mark.parametrize("size", ["0, 0", "0, 10", "10, 0", "1e-200, 1e-200", "nan, nan"])
def test_pixels_of_no_size_are_one_line(deglint, sea, write, tmp_path, size):
    source = write(tmp_path / "in.tif", sea())
    path = Path(write(tmp_path / "e.img", sea(), driver="ENVI")).with_suffix(".hdr")
    place = f"map info = {{UTM, 1, 1, 400000, 800000, {size}, 53, North, WGS-84}}"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(place if line.startswith("map info") else line for line in lines))
    for arguments in (["info", tmp_path / "e.img"], ["remove", tmp_path / "e.img", tmp_path / "o.tif"],
                      ["remove", source, tmp_path / "o.tif", "--mask", tmp_path / "e.img"]):  # fmt: skip
        ran = deglint(*arguments)
        assert ran.code == 1
        assert "cannot be inverted" in ran.err
        assert ran.err.count("\n") == 1


def test_names_that_are_not_text_are_called_that(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    odd = os.fsdecode(os.fsencode(tmp_path) + b"/b\xff.tif")
    Path(source).rename(odd)
    for arguments in (
        ["info", odd],
        ["remove", odd, tmp_path / "o.tif"],
        ["remove", tmp_path / "in.tif", odd + "2.tif"],
    ):
        ran = deglint(*arguments)
        assert ran.code == 1
        assert "b\\xff.tif" in ran.err
        assert "is not UTF-8" in ran.err
    assert [p.name for p in tmp_path.iterdir()] == [os.fsdecode(b"b\xff.tif")]
