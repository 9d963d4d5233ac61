"""What other programs can do, as their documentation and source say."""

from __future__ import annotations

COLUMNS = (
    "removes glint", "masks glint", "finds its sample", "takes any GeoTIFF", "larger than memory",
    "bands of several instants", "flags each pixel", "standard errors", "finds anomalies",
    "calibrated false alarms", "plans flights", "command",
)  # fmt: skip

FEATURES = {
    "deglint 0.2": "yes yes yes yes yes yes yes yes yes yes yes yes",
    "sungc 0.1.0": "yes no no no no no no no no no no no",
    "sensingpy 3.0.4": "yes no no no no no no no no no no no",
    "ASP glint_correct": "yes no from-a-mask one-band no no no no no no no yes",
    "ACOLITE 20260421": "yes yes not-needed no no no yes no no no no yes",
    "DroneWQ 1.0.1": "yes yes whole-image no by-image no no no no no no no",
    "GlintMaskGenerator 4.0.0": "no yes not-needed no by-image aligns-them no no no no no yes",
    "HyTools 1.6.1": "yes no no no yes no no no no no no script",
    "SUGAR": "yes no not-needed no no no no no no no no no",
    "spectral 0.25": "no no no no no no no no yes no no no",
    "Orfeo Toolbox 8.1": "no no no yes yes no no no yes no no yes",
}
"""A word for each column; a dash stands for a blank."""

ELSEWHERE = {
    "sungc 0.1.0": ("Cox and Munk; reads the Open Data Cube", "run: `sungc/algorithms.py`, commit c912918"),
    "sensingpy 3.0.4": (
        "indices, water masks, bathymetry from soundings beside it",
        "run: `sensingpy/preprocessing/deglinting.py`",
    ),
    "ASP glint_correct": (
        "one step of a whole chain from stereo images to depths",
        "run: copied by hand, the computing functions of `src/asp/Tools/glint_correct`, commit 2e7a401",
    ),
    "ACOLITE 20260421": (
        "removes the atmosphere; reads level 1 of some thirty sensors; turbidity, chlorophyll",
        "not run: no plain GeoTIFF, needs SWIR and tables that it downloads; read: `acolite/glint/`, commit d218a3a",
    ),
    "DroneWQ 1.0.1": (
        "from raw MicaSense captures to mosaics of chlorophyll and suspended matter",
        "run: `dronewq/lw_methods/hedley.py`",
    ),
    "GlintMaskGenerator 4.0.0": (
        "aligns the bands of drone cameras; masks for Metashape; a window to click in",
        "run: `glint_mask_tools/glint_algorithms.py`",
    ),
    "HyTools 1.6.1": (
        "topography and BRDF of imaging spectrometers, on a cluster",
        "not run: reads ENVI and NetCDF; read: `hytools/glint/`, commit da4766d",
    ),
    "SUGAR": (
        "needs neither NIR nor sample; CoastalWQL around it aligns and mosaics MicaSense captures",
        "run: `sunglint_correction/SUGAR.py` of pakhuiying/CoastalWQL, commit 5308cb3",
    ),
    "spectral 0.25": (
        "a hundred other functions for spectra",
        "no removal; `python -m benchmarks peers` measures its RX",
    ),
    "Orfeo Toolbox 8.1": (
        "some hundred other applications",
        "no removal; `python -m benchmarks detection` measures its RX, `LocalRxDetection`",
    ),
}
"""What each does that deglint does not, and what of it was run or read."""


def yes_no() -> list[list[str]]:
    """A row of features for each program."""
    return [[name, *(w.replace("-", " ") for w in words.split())] for name, words in FEATURES.items()]
