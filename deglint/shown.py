"""Safe display of text from untrusted files.

Names of bands, scenes and files may contain control characters for a terminal, or reverse the order of letters, so that
one name looks like another.
"""

from __future__ import annotations

import re
from urllib.parse import quote

_HIDDEN_CHARACTERS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u115f\u1160\u180e\u200b-\u200f\u2028-\u202e"
    "\u2060-\u206f\u3164\ufeff\ufff9-\ufffb\U000e0000-\U000e0fff\ud800-\udfff]"
)
"""Invisible characters: controls, direction marks, joiners, surrogates; without tab and newline."""


def shown(text: str) -> str:
    """Text with hidden characters escaped as in Python.

    Examples
    --------
    >>> shown("blue\\x1b[2J")
    'blue\\\\x1b[2J'
    """
    return text if text.isprintable() else _HIDDEN_CHARACTERS.sub(_spelled, text)


def in_file_name(text: str) -> str:
    """Text for a file name, with hidden characters percent-encoded.

    Examples
    --------
    >>> in_file_name("a\\u202eb")
    'a%E2%80%AEb'
    """
    return _HIDDEN_CHARACTERS.sub(lambda found: quote(found[0], errors="surrogateescape"), text)


def _spelled(found: re.Match[str]) -> str:
    code = ord(found[0])
    if 0xDC80 <= code <= 0xDCFF:  # a byte of a name that is not UTF-8
        code -= 0xDC00
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
