"""A Sentinel-2 product folder of a simulated scene, for the tutorials."""

import numpy as np
import rasterio

CENTRES = (442.7, 492.7, 559.8, 664.6, 704.1, 740.5, 782.8, 832.8, 864.7, 945.1, 1373.5, 1613.7, 2202.4)
METADATA = """<n1:Level-2A_User_Product xmlns:n1="x"><n1:General_Info>
<Product_Info><PROCESSING_LEVEL>Level-2A</PROCESSING_LEVEL></Product_Info>
<Product_Image_Characteristics><BOA_QUANTIFICATION_VALUE>10000</BOA_QUANTIFICATION_VALUE>
<Offset_List>{offsets}</Offset_List><Spectral_Information_List>{bands}</Spectral_Information_List>
</Product_Image_Characteristics></n1:General_Info></n1:Level-2A_User_Product>"""
BAND = """<Spectral_Information bandId="{}" physicalBand="{}"><RESOLUTION>10</RESOLUTION>
<Wavelength><MIN>{:g}</MIN><MAX>{:g}</MAX><CENTRAL>{:g}</CENTRAL></Wavelength></Spectral_Information>"""


def reflectance(sea, radiance):
    """Radiance at the sea as reflectance."""
    light = np.asarray(sea.light.direct) + np.asarray(sea.light.diffuse)
    return (np.pi * radiance / light.reshape(-1, 1, 1)).astype(np.float32)


def sentinel2_folder(folder, sea):
    """Write bands and metadata of a scene as Copernicus names them; the folder."""
    scales = [sea.setup.sensor.scale(band) for band in sea.setup.sensor.bands]
    counts = np.rint(10_000 * reflectance(sea, sea.image * np.reshape(scales, (-1, 1, 1))) + 1000).astype(np.uint16)
    profile = {"driver": "GTiff", "dtype": "uint16", "count": 1, "height": counts.shape[1], "width": counts.shape[2],
               "crs": "EPSG:32630", "transform": rasterio.Affine(10, 0, 600_000, 0, -10, 5_100_000)}  # fmt: skip
    for name, band in zip(("B02", "B03", "B04", "B08"), counts, strict=True):
        with rasterio.open(folder / f"{name}.tif", "w", **profile) as out:
            out.write(band, 1)
    codes = [*(f"B{n}" for n in range(1, 9)), "B8A", *(f"B{n}" for n in range(9, 13))]
    bands = "".join(
        BAND.format(i, code, w - 40, w + 40, w) for i, (code, w) in enumerate(zip(codes, CENTRES, strict=True))
    )
    offsets = "".join(f'<BOA_ADD_OFFSET band_id="{i}">-1000</BOA_ADD_OFFSET>' for i in range(13))
    (folder / "MTD_MSIL2A.xml").write_text(METADATA.format(bands=bands, offsets=offsets))
    return folder
