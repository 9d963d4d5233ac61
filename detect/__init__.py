"""detect: find anomalies in multispectral images, and measure how well known targets were detected.

    import detect

    scores = detect.rx(image)  # (band, row, column) -> (row, column)
    detect.score_file("clean.tif", "scores.tif", detect.Recipe(pfa=1e-4), objects="found.geojson")

The public names are listed in `__init__.pyi`; each is imported when it is first used, so that `import detect` is fast.
"""

import logging

import lazy_loader

from deglint import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

logging.getLogger(__name__).addHandler(logging.NullHandler())
