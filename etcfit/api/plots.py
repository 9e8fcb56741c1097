"""Pictures as matplotlib Axes of figures of pyplot: a notebook shows them, a script may call `plt.show()`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..control.design import Design
from ..control.frequency import FrequencyResponse
from ..control.linearise import Reduction
from ..diagnosis.findings import Diagnosis
from ..errors import UsageError
from ..estimation.fitted_model import Fitted
from ..estimation.result import FitResult
from ..posterior.sampling import Posterior
from ..problem.prediction_error import pooled
from ..reporting import pictures, style
from ..reporting.control import bode
from ..reporting.control import pictures as control_pictures
from ..reporting.diagnosis import pictures as diagnosis_pictures
from ..reporting.fleet import pictures as fleet_pictures
from ..reporting.fleet.page import Columns
from ..reporting.numbers import short
from .views import FittedTrace, traces_of
from .views import named as trace_named

if TYPE_CHECKING:
    from ..run_folder.fleet import FleetFiles

_ACROSS = 4  # panels of an overview
_SHORT = 0.1  # s; the time axis of a shorter trace is in ms
_INTEREST = ("position", "current", "motor_speed", "emf")  # an overview shows the first of these that was logged


def panels_of(draw: Callable[[], Figure]) -> np.ndarray:
    """Draw a figure in our style, register it with pyplot, and return its panels, shape (K,)."""
    with style.drawing():
        figure = draw()
    plt.figure(figure)
    out = np.empty(len(figure.axes), dtype=object)
    out[:] = figure.axes
    return out


def _by_name(jobs: list[tuple[Path, Callable[[], Figure]]]) -> dict[str, Callable[[], Figure]]:
    return {path.with_suffix("").as_posix(): draw for path, draw in jobs}


@dataclass(frozen=True, eq=False)
class FitPlots:
    """Pictures of a fit."""

    result: FitResult

    def trace(self, file: str) -> np.ndarray:
        """Measured and simulated channels, the residual below each, and the input; Axes from the top, shape (K,).

        Args:
            file: as in `fit.traces`.
        """
        trace = trace_named(traces_of(self.result), file).trace
        name = pictures.file_name(trace).removesuffix(".png")
        return panels_of(_by_name(pictures.jobs(self.result))[f"traces/{name}"])

    def parameters(self) -> Axes:
        """Interval of each parameter, and the error of the value read from a graph with a ruler."""
        return panels_of(lambda: pictures.draw_parameters(pictures.parameter_picture(self.result)))[0]

    def test(self, name: str) -> np.ndarray:
        """The graph that the paper reads of one rig test, with the fit drawn into it.

        Args:
            name: of the rig test, as `static_load`.
        """
        jobs = _by_name(pictures.jobs(self.result))
        there = ", ".join(key.removeprefix("tests/") for key in jobs if key.startswith("tests/"))
        if f"tests/{name}" not in jobs:
            raise UsageError(f"no trace belongs to a test called {name!r}. There are: {there}.")
        return panels_of(jobs[f"tests/{name}"])

    def overview(self, most: int = 40) -> np.ndarray:
        """Overview of every trace, measured and simulated, one channel each; Axes, shape (K,).

        Args:
            most: number of traces that are shown; if there are more, the worst ones, held-out traces first.
        """
        return panels_of(lambda: _overview(self.result, most))


def _overview(result: FitResult, most: int) -> Figure:
    def error(each: FittedTrace) -> float:
        return pooled(pictures.errors_of(result, each.file))

    every = list(traces_of(result).values())
    count = len(every)
    every.sort(key=lambda each: (not each.held_out, each.trace.test.name))
    if count > most:
        every = sorted(every, key=lambda each: (not each.held_out, -error(each)))[:most]
    down = -(-len(every) // _ACROSS)
    tall = 0.75 + 1.95 * down
    fig = style.figure(13.0, tall, result.rig.config.synthetic)
    grid = fig.subplots(down, _ACROSS, squeeze=False)
    for panel, each in zip(grid.flat, every, strict=False):
        _glance(panel, each, error(each))
    for panel in list(grid.flat)[len(every) :]:
        panel.remove()
    more = f", the worst {len(every)} of {count}" if len(every) < count else ""
    fig.suptitle(f"{result.rig.config.name}  ·  every trace{more}", x=0.01, ha="left", fontsize=13)
    fig.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.35 / tall), w_pad=0.6)
    style.legend(fig, list(grid.flat)[:1], 0.99, 1.0 - 0.35 / tall)
    return fig


def _glance(panel: Axes, each: FittedTrace, off: float) -> None:
    channel = min(each.channels, key=lambda name: _INTEREST.index(name) if name in _INTEREST else len(_INTEREST))
    frame, alone = each.to_frame(), len(each.channels) == 1
    measured, simulated = (what if alone else f"{channel}_{what}" for what in ("measured", "simulated"))
    time, unit = frame["time"].to_numpy(), "s"
    if np.ptp(time) < _SHORT:
        time, unit = 1e3 * time, "ms"
    panel.plot(*style.thin(time, frame[measured].to_numpy()), ".", ms=2.0, color=style.MEASURED, label="measured")
    panel.plot(*style.thin(time, frame[simulated].to_numpy()), color=style.SIMULATED, lw=1.2, label="simulated")
    role = ", held out" if each.held_out else ""
    panel.set_title(f"{each.file.removesuffix('.csv')}: {short(off, 2)} σ{role}", loc="left", fontsize=9)
    panel.set_ylabel(style.unit_label(channel, each.units[measured]), fontsize=9)
    panel.set_xlabel(f"time [{unit}]", fontsize=9, labelpad=1.0)
    panel.xaxis.set_major_locator(MaxNLocator(5))
    panel.tick_params(labelsize=8)


@dataclass(frozen=True, eq=False)
class DiagnosisPlots:
    """Pictures of a diagnosis."""

    diagnosis: Diagnosis

    def ledger(self) -> Axes:
        """Errors before and after, by test and channel."""
        return self._named("ledger", "the model cannot be simulated: there are no errors to draw.")[0]

    def missing_torque(self) -> np.ndarray:
        """The torque that the first and the final model lack along the measured motion."""
        return self._named("missing_torque", "no trace shows what torque the model lacks: none moves the plate.")

    def missing_voltage(self) -> np.ndarray:
        """The voltage that both models lack, where the current was logged."""
        return self._named("missing_voltage", "no trace shows what voltage the model lacks: none logs the current.")

    def rounds(self) -> np.ndarray:
        """The candidates of each round, and the residual after it."""
        return self._named("rounds", "nothing was tried: there are no rounds to draw.")

    def unexplained(self) -> np.ndarray:
        """The part of the residual that no effect explains, as a curve."""
        return self._named("unexplained", "nothing is left unexplained: there is no curve to draw.")

    def parameters(self) -> Axes:
        """Parameters of the final model."""
        return FitPlots(self.diagnosis.after).parameters()

    def trace(self, file: str) -> np.ndarray:
        """Measured, the first and the final model, and the errors of both; Axes, shape (K,).

        Args:
            file: as in `found.final.traces`.
        """
        aside = {each.trace.measurement.file: each.trace for each in self.diagnosis.aside}
        trace = aside[file] if file in aside else trace_named(traces_of(self.diagnosis.after), file).trace
        picture = diagnosis_pictures.Overlay.of_trace(self.diagnosis, trace)
        return panels_of(lambda: diagnosis_pictures.draw_overlay(picture))

    def _named(self, name: str, why_not: str) -> np.ndarray:
        jobs = _by_name(diagnosis_pictures.jobs(self.diagnosis))
        if name not in jobs:
            raise UsageError(why_not)
        return panels_of(jobs[name])


@dataclass(frozen=True, eq=False)
class PosteriorPlots:
    """Pictures of a posterior."""

    posterior: Posterior

    def corner(self) -> np.ndarray:
        """Every free parameter against every other; Axes, shape (P, P)."""
        size = len(self.posterior.chain.symbols)
        return self._drawn("corner")[: size * size].reshape(size, size)

    def intervals(self) -> Axes:
        """95 % intervals of the fit and of the posterior side by side."""
        return self._drawn("intervals")[0]

    def _drawn(self, name: str) -> np.ndarray:
        from ..reporting.posterior.pictures import jobs

        return panels_of(_by_name(jobs(self.posterior, {}, ()))[name])


@dataclass(frozen=True, eq=False)
class ReductionPlots:
    """Pictures of a linear plant."""

    # fitted, reduction: the model and its linear plant
    fitted: Fitted
    reduction: Reduction
    response: FrequencyResponse | None  # frequency response measured by the rig's sine traces, or None

    def bode(self) -> np.ndarray:
        """Magnitude above phase, with 95 % bands; Axes, shape (2,)."""
        return panels_of(lambda: bode.draw(self.fitted, self.reduction))

    def sines(self) -> np.ndarray:
        """The rig's sine traces and the model."""
        response = self.response
        if response is None or not response.points:
            raise UsageError("no sine trace of this rig gives a measured response: there is nothing to draw.")
        return panels_of(lambda: bode.draw_sines(self.fitted.config, response))


@dataclass(frozen=True, eq=False)
class DesignPlots:
    """Pictures of PID gains."""

    design: Design

    def responses(self) -> np.ndarray:
        """Setpoint and response by every rule, one panel per rule."""
        return panels_of(lambda: control_pictures.draw_responses(self.design))

    def scenarios(self) -> np.ndarray:
        """The proposed gains in every scenario, a panel each."""
        return panels_of(lambda: control_pictures.draw_scenarios(self.design))

    def front(self) -> Axes:
        """Tracking error over the duty's activity: the best gains, and every rule."""
        return panels_of(lambda: control_pictures.draw_front(self.design))[0]

    def safety(self) -> np.ndarray:
        """Jam check, failing sensor, spring return, holding current; Axes, shape (4,)."""
        return panels_of(lambda: control_pictures.draw_safety(self.design))


@dataclass(frozen=True)
class FleetPlots:
    """Pictures of a fleet; each method returns its panels, shape (K,)."""

    files: FleetFiles

    def population(self) -> np.ndarray:
        """Every unit's parameters with their intervals, and the population."""
        content = self.files.content
        columns = Columns.of_units(content["units"], self.files.units)
        return panels_of(lambda: fleet_pictures.draw_population(content, columns))

    def correlation(self) -> np.ndarray:
        """Correlation of parameters between units."""
        return panels_of(lambda: fleet_pictures.draw_correlation(self.files.content))

    def charts(self, *symbols: str) -> np.ndarray:
        """Control chart and cumulative sums, one figure per symbol.

        Args:
            symbols: symbols to draw; all that have a chart if none is named.
        Raises:
            UsageError: a symbol has no chart.
        """
        there = self.files.content["charts"]
        if unknown := [symbol for symbol in symbols if symbol not in there]:
            raise UsageError(f"there is no chart of {unknown[0]}. There are: {', '.join(there) or 'none'}.")
        drawn = [panels_of(lambda s=s: fleet_pictures.draw_chart(self.files.content, s)) for s in symbols or there]
        return np.concatenate(drawn) if drawn else np.empty(0, dtype=object)

    def odd(self) -> np.ndarray:
        """Distance of each unit from the population, and which parameters make units odd."""
        if not self.files.content["odd"]:
            raise UsageError("no unit of this fleet is odd: there is nothing to draw.")
        return panels_of(lambda: fleet_pictures.draw_odd(self.files.content))
