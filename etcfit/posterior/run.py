"""Sampling in blocks of steps, each kept on disk and judged, until the chain has converged or the budget is spent."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ..estimation.joint_fit import Report
from ..files import put_aside
from .chain import Chain, Damaged, load, save
from .convergence import Convergence
from .ensemble import LogProbability
from .settings import SamplingSettings

BLOCK = SamplingSettings().block


def run(
    target: LogProbability,
    symbols: tuple[str, ...],
    begin: Callable[[], Chain],
    path: Path,
    most: int,
    report: Report,
    settings: SamplingSettings = SamplingSettings(),
    remark: Callable[[str], None] = lambda said: None,
) -> tuple[Chain, Convergence]:
    """Sample until the chain has converged; go on from what is kept in `path` if that belongs to the target. Else what
    is kept is hours of work all the same, and is put aside.

    Args:
        target: log-probability of coordinates, shape (K, P) -> (K,).
        symbols: of the coordinates, P.
        begin: a chain of no steps.
        path: file of the chain.
        most: steps after which to stop whether the chain has converged or not.
        report: called after each block with acceptance, tau, effective samples and time left, and the share done.
        settings: steps of a block, and when a chain has converged.
        remark: told that a chain was put aside, and why.
    Returns:
        the whole chain, and the verdict on it.
    """
    chain = _taken_up(path, target, symbols, begin, remark)
    here = Convergence.of(chain.ensembles, settings)
    began, first = time.monotonic(), here.steps
    while not here.converged and here.steps < most:
        chain = chain.advanced(target, min(settings.block, most - here.steps))
        save(path, chain)
        here = Convergence.of(chain.ensembles, settings)
        pace = (time.monotonic() - began) / (here.steps - first)
        report(_words(here, most, pace), here.steps / max(here.steps, min(here.needed, most)))
    return chain, here


def _taken_up(
    path: Path,
    target: LogProbability,
    symbols: tuple[str, ...],
    begin: Callable[[], Chain],
    remark: Callable[[str], None],
) -> Chain:
    """The chain that is kept, where it is whole and the target's, else the new one."""
    try:
        kept = load(path)
        why = "belongs to another model or other data"
    except Damaged as error:
        kept, why = None, f"cannot be read ({error})"
    if kept is not None and kept.belongs_to(target, symbols):
        return kept
    if path.exists():
        remark(f"{path} {why}: it was moved to {put_aside(path)}, and a new chain begun.")
    return begin()


def _words(here: Convergence, most: int, pace: float) -> str:
    """Acceptance, tau, effective samples and time left; `pace` in seconds a step."""
    text = f"step {here.steps}: {100.0 * here.acceptance:.0f} % accepted"
    if here.longest != here.longest:
        return f"{text}, {pace:.2g} s a step"
    left = pace * (min(here.needed, most) - here.steps)
    return f"{text}, tau {here.longest:.0f}, {here.effective:.0f} effective samples, about {_duration(left)} left"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.1f} min"
