"""deglint: find and remove sun glint in multispectral images of the sea.

    import deglint

    deglint.remove_glint("scene.tif", "clean.tif")  # file to file, tile by tile

    scene = deglint.open_scene("scene.tif")  # or step by step
    fitted = deglint.fit_scene(scene, deglint.Recipe(method="hedley"))
    clean = deglint.correct(scene, fitted)

Band numbers start at 1 where a user writes them (`Recipe`, `open_scene`, `find_nir`, the command line), and at 0 where
they index an array (`fit`, `apply`, `Scene.read`, the value that `find_nir` returns).

Decisions are logged to the logger "deglint" and its children (`logging`); nothing is printed. The public names are
listed in `__init__.pyi`; each is imported when it is first used, so that `import deglint` is fast.
"""

import logging

import lazy_loader

try:
    from ._version import __version__
except ModuleNotFoundError:  # a source tree that is not installed
    __version__ = "0+unknown"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

logging.getLogger(__name__).addHandler(logging.NullHandler())
