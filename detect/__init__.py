"""detect: find anomalies in multispectral images, and measure how well known targets were detected.

    import detect

    scores = detect.rx(image)  # (band, row, column) -> (row, column)
    detect.score_file("clean.tif", "scores.tif", detect.Recipe(pfa=1e-4), objects="found.geojson")

Each public name is loaded when it is first used, so that importing detect is fast.
"""

import logging
from typing import TYPE_CHECKING

from deglint import __version__

if TYPE_CHECKING:
    from .background import Background as Background
    from .lines import LineScorer as LineScorer
    from .lines import score_lines as score_lines
    from .local import local_rx as local_rx
    from .objects import Object as Object
    from .pipeline.recipe import Recipe as Recipe
    from .pipeline.run import Result as Result
    from .pipeline.run import score_file as score_file
    from .roc.curve import Roc as Roc
    from .rx import residual_rx as residual_rx
    from .rx import rx as rx
    from .rx import rx_utd as rx_utd
    from .rx import subspace_rx as subspace_rx
    from .rx import utd as utd
    from .sea.search import Search as Search
    from .sea.search import score_scene as score_scene
    from .threshold import Tail as Tail
    from .threshold import Threshold as Threshold

_NAMES = {
    "background": ("Background",),
    "lines": ("LineScorer", "score_lines"),
    "local": ("local_rx",),
    "objects": ("Object",),
    "pipeline.recipe": ("Recipe",),
    "pipeline.run": ("Result", "score_file"),
    "roc.curve": ("Roc",),
    "rx": ("residual_rx", "rx", "rx_utd", "subspace_rx", "utd"),
    "sea.search": ("Search", "score_scene"),
    "threshold": ("Tail", "Threshold"),
}
"""Public names of each module. Type checkers read the imports above; a test compares the two."""
_HOMES = {name: module for module, names in _NAMES.items() for name in names}

__all__ = ["__version__", *_HOMES]

logging.getLogger(__name__).addHandler(logging.NullHandler())

if not TYPE_CHECKING:  # with this function, a type checker would accept any name

    def __getattr__(name: str) -> object:
        """Load a public name from its module when it is first used."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        home = import_module(f".{_HOMES[name]}", __name__)
        return home if name == "rx" else getattr(home, name)  # the module detect.rx is called like its function


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
