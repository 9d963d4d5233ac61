"""Metadata of a product are files that a run reads: no output replaces them, and a change of them is noticed."""

import os
from pathlib import Path

import pytest

from deglint.checksum import Checksum, are_as
from deglint.readers.products import files_of


@pytest.fixture
def product(make, sea, tmp_path):
    return make.sentinel2(tmp_path, sea())


def test_metadata_are_among_the_files(product):
    found = {Path(f).name for f in files_of(str(product))}
    assert "MTD_MSIL2A.xml" in found
    assert any(name.endswith((".jp2", ".tif")) for name in found)
    assert all(Path(f).exists() for f in files_of(str(product)))


@pytest.mark.parametrize("output", ["MTD_MSIL2A.xml", "link.tif"])
def test_metadata_are_never_replaced(deglint, product, tmp_path, output):
    metadata = next(product.rglob("MTD_MSIL2A.xml"))
    before = metadata.read_bytes()
    target = metadata if output == "MTD_MSIL2A.xml" else tmp_path / output
    if target != metadata:
        os.link(metadata, target)
    ran = deglint("remove", product, tmp_path / "o.tif", "--flags", target, "--overwrite")
    assert ran.code == 1
    assert "would be lost" in ran.err
    assert metadata.read_bytes() == before


def test_a_change_of_metadata_is_another_state(product):
    files = files_of(str(product))
    said = {f["path"]: f for f in Checksum(files).fingerprints()}
    assert are_as(files, said)
    metadata = next(product.rglob("MTD_MSIL2A.xml"))
    metadata.write_text(metadata.read_text() + "\n")
    assert not are_as(files_of(str(product)), said)
