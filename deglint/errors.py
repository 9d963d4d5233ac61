"""The exceptions that deglint raises; each is also a subclass of the matching builtin exception.

Every message is one line: what was wrong, where, and a remedy. This module imports nothing of the project.
"""


class DeglintError(Exception):
    """Base class of the project's exceptions."""


class InputError(DeglintError, ValueError):
    """An option, array or file content is not valid."""


class ReadError(DeglintError, OSError):
    """A file or address cannot be opened or read, or has changed while it was read."""


class WriteError(DeglintError, OSError):
    """An output cannot be written; no partial file is left."""


class BandError(InputError, LookupError):
    """A band that the user selects, or that a method needs, is not in the scene."""


class FitError(DeglintError, ValueError):
    """The sample does not allow a fit, for example because it has too few pixels or no variation."""


class NoWaterError(FitError):
    """The scene was read, but contains no usable water, no pixel to correct, or too few pixels for a fit."""
