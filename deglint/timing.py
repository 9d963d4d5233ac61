"""Remaining time of a stage, from the rate of finished tiles; and progress as log lines."""

from __future__ import annotations

import logging
import time

LOG_EVERY = 30.0
"""Least time between two log lines on progress [s]: a stage that takes less needs none."""
log = logging.getLogger(__name__)


class TimeLeft:
    """Time left of a stage: what remains, at the mean rate since the stage's first report.

    Examples
    --------
    >>> left = TimeLeft()
    >>> left("correct", 1, 10, now=0.0), left("correct", 4, 10, now=6.0)
    (None, 12.0)
    """

    def __init__(self) -> None:
        self._stage = ""
        self._first = (0, 0.0)

    def __call__(self, stage: str, done: int, total: int, *, now: float | None = None) -> float | None:
        """Seconds, or None at a stage's first report."""
        now = time.monotonic() if now is None else now
        if stage != self._stage or done < self._first[0]:
            self._stage, self._first = stage, (done, now)
        finished, since = done - self._first[0], now - self._first[1]
        return since / finished * (total - done) if finished else None


class Reporter:
    """A progress function that logs at most every `LOG_EVERY` seconds, the first time that long after a stage began."""

    def __init__(self) -> None:
        self._left, self._said = TimeLeft(), 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take in that `done` of `total` tiles are finished."""
        now, left = time.monotonic(), self._left(stage, done, total)
        if left is None:  # the stage begins
            self._said = now
        elif done < total and now - self._said >= LOG_EVERY:
            self._said = now
            log.info("%s: %d %%, %s left", stage, 100 * done // total, duration(left))


def duration(seconds: float) -> str:
    """A time for people.

    Examples
    --------
    >>> duration(4.4), duration(200), duration(9000)
    ('4 s', '3 min', '2.5 h')
    """
    if seconds < 99.5:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"
