"""The errors that deglint raises: few, each also the builtin a caller would guess.

Every message is one line that says what was wrong, where, and what to do about it.
This room imports nothing of the project.
"""


class DeglintError(Exception):
    """Base of every error raised on purpose by this project."""


class InputError(DeglintError, ValueError):
    """An option, array or file content that cannot be used as it is."""


class ReadError(DeglintError, OSError):
    """A raster or vector file that cannot be opened or read."""


class WriteError(DeglintError, OSError):
    """An output that cannot be written; nothing was left half-written."""


class BandError(InputError, LookupError):
    """A band that is asked for, or needed, and is not in the scene."""


class FitError(DeglintError, ValueError):
    """Statistics that cannot carry a fit: too few pixels, or no variation."""


class NoWaterError(DeglintError, ValueError):
    """The scene was read, and the answer is no: there is no usable water in it."""
