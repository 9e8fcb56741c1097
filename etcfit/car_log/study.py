"""All that is asked of one log, and two of them beside each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import UsageError
from .log import DriveLog
from .spectrum import Spectrum, spectrum
from .tracking import Tracking, tracking
from .usage import BOUNDS, Usage, usage

_CLEAR = 2.0  # standard errors by which two logs must differ
_MANY = "more than 100"


@dataclass(frozen=True, eq=False)
class Study:
    """What one log says.

    Args:
        log: it.
        usage: where the plate spends its time.
        spectrum: how fast it is moved; None of a log that is too short.
        tracking: how closely it follows; None where no setpoint was logged.
    """

    log: DriveLog
    usage: Usage
    spectrum: Spectrum | None
    tracking: Tracking | None


def study(log: DriveLog, bounds: tuple[float, float] = BOUNDS) -> Study:
    """Study a log; the share of time is given between two positions, per cent."""
    follows = None if log.setpoint is None else tracking(log.position, log.setpoint)
    return Study(log, usage(log.position, bounds), spectrum(log.position), follows)


def chosen(logs: Sequence[DriveLog], names: Sequence[str]) -> tuple[DriveLog, ...]:
    """Logs by the names of their files, in the order asked for.

    Raises:
        UsageError: there is none of that name.
    """
    known = {log.name: log for log in logs}
    for name in names:
        if name not in known:
            raise UsageError(f"no log is called {name}. There are: {', '.join(known)}.")
    return tuple(known[name] for name in names)


def verdict(before: Study, after: Study) -> str:
    """Two logs, before and after new gains, in a sentence."""
    was, now = before.tracking, after.tracking
    if was is None or now is None:
        return "Without a setpoint in both logs nothing can be said of how closely the plate follows."
    text = f"RMSE {was.rmse:.2f} -> {now.rmse:.2f} % of travel"
    if was.lag is not None and now.lag is not None:
        text += f", lag {1e3 * was.lag:.0f} -> {1e3 * now.lag:.0f} ms"
    return " ".join((f"{text}.", *_clear(was, now), _alike(was, now)))


def _clear(was: Tracking, now: Tracking) -> Iterator[str]:
    """How sure the difference in RMSE is, and that in lag."""
    if was.stderr is None or now.stderr is None:
        yield "The logs are too short to say by how much the RMSE varies by itself."
        return
    sd = float(np.hypot(was.stderr, now.stderr))
    yield _told("RMSE", now.rmse - was.rmse, sd, f"{sd:.2f} %")
    if was.lag is None or now.lag is None or was.lag_stderr is None or now.lag_stderr is None:
        return
    sd = float(np.hypot(was.lag_stderr, now.lag_stderr))
    yield _told("lag", now.lag - was.lag, sd, f"{1e3 * sd:.1f} ms")


def _told(name: str, difference: float, sd: float, shown: str) -> str:
    if abs(difference) <= _CLEAR * sd:
        return f"The difference in {name} is within what it varies by itself ({shown})."
    errors = abs(difference) / max(sd, 1e-300)
    return f"The difference in {name} is clear ({_MANY if errors > 100.0 else format(errors, '.1f')} standard errors)."


def _alike(was: Tracking, now: Tracking) -> str:
    ratio = now.demand / was.demand if was.demand > 0.0 else np.inf
    if 0.8 < ratio < 1.25:
        return "Both drives ask about as much of the throttle."
    return f"But the second drive's setpoint moves {ratio:.2f} times as fast: the figures are not of like drives."
