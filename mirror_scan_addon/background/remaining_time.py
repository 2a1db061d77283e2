"""How long a job still takes, from the time it has taken and the share of it that is done."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..language.texts import say

LEAST_S = 1.0  # of work before anything is said
LEAST_SHARE = 0.05  # of the whole before anything is said
KEPT = 0.6  # of the estimate of before: fractions advance in steps


class Clock:
    """Estimates of one job; it begins when it is made.

    Parameters
    ----------
    now : callable
        Seconds of a clock that never goes back.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._began = now()
        self._end: float | None = None  # when it is expected to be done

    def seconds(self, fraction: float) -> float | None:
        """Seconds left when ``fraction`` is done; None while that cannot be said."""
        spent = self._now() - self._began
        if spent < LEAST_S or fraction < LEAST_SHARE:
            return None
        end = self._began + spent / min(fraction, 1.0)
        self._end = end if self._end is None else KEPT * self._end + (1.0 - KEPT) * end
        return max(self._end - self._now(), 0.0)

    def left(self, fraction: float) -> str:
        """:meth:`seconds` in words; "" while that cannot be said."""
        seconds = self.seconds(fraction)
        return "" if seconds is None else in_words(seconds)


def in_words(seconds: float) -> str:
    """A time left, no finer than it is known."""
    if seconds < 1.5:
        return say("about 1 s left")
    if seconds < 10:
        return say("about {seconds} s left").format(seconds=round(seconds))
    if seconds < 100:
        return say("about {seconds} s left").format(seconds=5 * round(seconds / 5))
    return say("about {minutes} min left").format(minutes=round(seconds / 60))
