"""How the error fell, round by round, and what else was tried."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...diagnosis.findings import Candidate, Diagnosis, RoundReport
from ...estimation.identifiability import listed
from .. import style
from ..numbers import short
from ..pool import Pool

_NAMED = 3  # rejected candidates named in a round
_APART = 1.35  # ratio of errors above which two names do not touch


@dataclass(frozen=True)
class RoundPoint:
    """One turn of the loop.

    Args:
        label: what was added.
        fit, holdout: free-running error after it, sigma; the latter None without held-out traces.
        others: refitted candidates that were not taken, and the error they would have left.
    """

    label: str
    fit: float
    holdout: float | None
    others: tuple[tuple[str, float], ...] = ()


def steps(diagnosis: Diagnosis) -> list[RoundPoint]:
    """Errors from the first fit to the final one; between them those of the trials, before the full refit."""
    before, after = diagnosis.before, diagnosis.after
    out = [RoundPoint("start", Pool.of(before.score_fit).ratio, _ratio(before.score_holdout))]
    if diagnosis.aside:
        files = "\n".join(each.trace.measurement.file for each in diagnosis.aside)
        first = diagnosis.rounds[0]
        out.append(RoundPoint(f"without\n{files}", first.fit_rms, first.holdout_rms))
    for each in diagnosis.rounds:
        others = tuple((c.effect, e) for c in each.candidates if (e := _left(c, each)) and c.effect != each.added)
        taken = next((c for c in each.candidates if c.effect == each.added), None)
        fit, holdout = each.fit_rms, each.holdout_rms
        if taken is not None:
            fit *= taken.fit_rms_ratio or 1.0
            holdout = None if holdout is None else holdout * (taken.holdout_rms_ratio or 1.0)
        out.append(RoundPoint(f"+ {each.added}" if each.added else "nothing more", fit, holdout, others))
    end = RoundPoint("final fit", Pool.of(after.score_fit).ratio, _ratio(after.score_holdout))
    if out[-1].label == "nothing more":  # one place for both
        end = replace(end, label="nothing more:\nfinal fit", others=out.pop().others)
    return [*out, end]


def _ratio(rows: tuple) -> float | None:
    return Pool.of(rows).ratio if rows else None


def _left(candidate: Candidate, each: RoundReport) -> float | None:
    """The error that a candidate would have left: held out, or fitted where nothing is held out."""
    if each.holdout_rms is None:
        return None if candidate.fit_rms_ratio is None else each.fit_rms * candidate.fit_rms_ratio
    return None if candidate.holdout_rms_ratio is None else each.holdout_rms * candidate.holdout_rms_ratio


def draw(every: list[RoundPoint], added: tuple[str, ...], synthetic: bool) -> Figure:
    """Error over rounds."""
    title = style.wrapped(_title(every, added), 11.0, 13)
    fig = style.figure(11.0, 5.6, synthetic)
    panel = fig.subplots(1, 1)
    head = 1.0 + 0.26 * title.count("\n")
    fig.subplots_adjust(left=0.09, right=0.97, top=1.0 - head / 5.6, bottom=0.14)
    place = np.arange(len(every))
    panel.axhline(1.0, color=style.MEASURED, lw=1.2, ls=":", label="noise of one sample")
    panel.plot(place, [s.fit for s in every], "o--", color=style.BEFORE, ms=7, label="fitted traces")
    held_out = [s.holdout if s.holdout is not None else np.nan for s in every]
    if np.isfinite(held_out).any():
        panel.plot(place, held_out, "o-", color=style.AFTER, ms=9, lw=2.2, label="held-out traces")
    led = held_out if np.isfinite(held_out).any() else [s.fit for s in every]
    for k, value in enumerate(led):
        panel.annotate(f"{short(value)} σ", (k, value), xytext=(-9, -6), textcoords="offset points", fontsize=11,
                       va="top", ha="right", fontweight="bold")  # fmt: skip
    _others(panel, every)
    _axes(panel, every)
    fig.suptitle(title, x=0.015, y=0.98, ha="left", va="top", fontsize=13, fontweight="bold")
    style.legend(fig, [panel], 0.09, 1.0 - (head - 0.36) / 5.6, "upper left")
    return fig


def _title(every: list[RoundPoint], added: tuple[str, ...]) -> str:
    first, last = every[0], every[-1]
    which = "Held-out" if last.holdout is not None else "Fitted"
    was, now = (first.holdout, last.holdout) if last.holdout is not None else (first.fit, last.fit)
    if not added:
        return f"{which} error {short(now)} σ: nothing was added"
    return f"{which} error {short(was)} → {short(now)} σ with {listed(added)}"


def _others(panel: Axes, every: list[RoundPoint]) -> None:
    for k, step in enumerate(every):
        others = sorted(step.others, key=lambda other: other[1])
        for n, (_, error) in enumerate(others):
            panel.plot(k, error, "D", ms=6, mfc="white", color="#8c8c8c", ls="none",
                       label="refitted, not taken" if n == 0 else "_")  # fmt: skip
        for error, names in labels(others[:_NAMED]):
            last = k == len(every) - 1  # to its right the picture ends
            panel.annotate(", ".join(names), (k, error), xytext=(-7 if last else 7, 5), textcoords="offset points",
                           va="bottom", ha="right" if last else "left", fontsize=9, color="#6b6b6b")  # fmt: skip


def labels(others: list[tuple[str, float]]) -> list[tuple[float, list[str]]]:
    """Names by their errors, ascending; those whose letters would lie on each other share a line."""
    lines: list[tuple[float, list[str]]] = []
    for name, error in others:
        if lines and error < _APART * lines[-1][0]:
            lines[-1][1].append(name)
        else:
            lines.append((error, [name]))
    return lines


def _axes(panel: Axes, every: list[RoundPoint]) -> None:
    panel.set_yscale("log")
    panel.set_xticks(range(len(every)), [step.label for step in every])
    panel.set_xlim(-0.4, len(every) - 0.3)
    low, high = panel.get_ylim()
    panel.set_ylim(min(0.7, 0.8 * low), max(2.5, 1.2 * high))
    style.log_ticks(panel.yaxis, panel.get_ylim())
    panel.set_ylabel("free-running error, rms [σ of one sample]")
