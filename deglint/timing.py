"""Log the progress of a stage of a run, with the remaining time that follows from the rate of finished tiles."""

import logging
import time

LOG_EVERY = 30.0  # least time between two log lines on progress [s]; a shorter stage logs none
log = logging.getLogger(__name__)


class Reporter:
    """A progress function that logs at most every `LOG_EVERY` s, and not in the first `LOG_EVERY` s of a stage."""

    def __init__(self) -> None:
        self._stage, self._first, self._begun, self._said = "", 0, 0.0, 0.0

    def left(self, stage: str, done: int, total: int) -> str:
        """Remaining time of a stage as text, from the mean rate since its first report; empty until `done` grows."""
        now = time.monotonic()
        if stage != self._stage or done <= self._first:
            self._stage, self._first, self._begun, self._said = stage, done, now, now
            return ""
        return duration((now - self._begun) / (done - self._first) * (total - done))

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Note that `done` of `total` tiles of a stage are finished; log the time left at most every `LOG_EVERY` s."""
        left = self.left(stage, done, total)
        if left and done < total and time.monotonic() - self._said >= LOG_EVERY:
            self._said = time.monotonic()
            log.info("%s: %d %%, %s left", stage, 100 * done // total, left)


def duration(seconds: float) -> str:
    """Convert a duration [s] to a short text in seconds, minutes or hours.

    >>> duration(4.4), duration(200), duration(9000)
    ('4 s', '3 min', '2.5 h')
    """
    if seconds < 99.5:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"
