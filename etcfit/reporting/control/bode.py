"""Bode plots: of the transfer function, with delay, sensor lag and interval; of sine traces, measured and modelled.

Below the latter is the distortion of the motion, which dry friction and limp-home spring cause and a Bode plot hides.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...control.frequency import FrequencyResponse, Order, Point, Ratio, phases
from ...control.frequency.response import DRIVE, POSITION, SETPOINT
from ...control.linearise import Reduction
from ...estimation.fitted_model import Fitted
from ...model.linear import TransferFunction
from ...rig.base import RigConfig
from .. import style

_HERTZ = np.geomspace(0.02, 500.0, 400)
_DRAWS = 300


def _coefficients(reduction: Reduction) -> np.ndarray:
    """Draws of b0, a2, a1, a0 from their covariance, shape (D, 4)."""
    mean = np.array([*reduction.plant.num, *reduction.plant.den[1:]])
    rng = np.random.default_rng(0)
    # relative, because the coefficients differ widely in size
    scale = np.where(mean == 0.0, 1.0, mean)  # a plant without a spring has a0 = 0, exactly
    spread = reduction.covariance / np.outer(scale, scale)
    variance, directions = np.linalg.eigh(spread)
    sd = np.sqrt(np.maximum(variance, 0.0))
    return mean * np.exp((rng.standard_normal((_DRAWS, 4)) * sd) @ directions.T)


def draw(fitted: Fitted, reduction: Reduction) -> Figure:
    """Magnitude above phase, over frequency in Hz."""
    plant, state = reduction.plant, fitted.state
    fig = style.figure(10.0, 6.2, fitted.config.synthetic)
    top, bottom = fig.subplots(2, 1, sharex=True)
    fig.subplots_adjust(left=0.11, right=0.97, top=0.86, bottom=0.09, hspace=0.1)
    s = 2j * np.pi * _HERTZ
    each = np.array([TransferFunction(*row)(s) for row in _coefficients(reduction).tolist()])
    known = "95 % interval" if state.compromise is None else "range that subsets of the data give"
    _band(top, 20.0 * np.log10(np.abs(each)), known)
    _band(bottom, np.degrees(np.unwrap(np.angle(each), axis=1)), known)
    bare, whole = plant.bare()(s), plant(s)
    top.plot(_HERTZ, 20.0 * np.log10(np.abs(bare)), color=style.SIMULATED, label="third order")
    bottom.plot(_HERTZ, np.degrees(np.unwrap(np.angle(bare))), color=style.SIMULATED, label="third order")
    if plant.delay or plant.lag:
        late = f"with {1e3 * plant.delay:.2g} ms delay, {1e3 * plant.lag:.2g} ms sensor lag"
        top.plot(_HERTZ, 20.0 * np.log10(np.abs(whole)), "--", color=style.READING, label=late)
        bottom.plot(_HERTZ, np.degrees(np.unwrap(np.angle(whole))), "--", color=style.READING, label=late)
    bottom.axhline(-180.0, color="black", lw=0.8)
    top.set_ylabel(f"magnitude [dB re 1 {reduction.output_unit}/{reduction.input_unit}]")
    bottom.set_ylabel("phase [deg]")
    bottom.set_xlabel("frequency [Hz]")
    bottom.set_xscale("log")
    bottom.set_xlim(_HERTZ[0], _HERTZ[-1])
    bottom.set_ylim(-290.0, 10.0)
    bottom.set_yticks(np.arange(-270.0, 1.0, 90.0))
    style.log_ticks(bottom.xaxis, (_HERTZ[0], _HERTZ[-1]))
    style.quiet_axis(top)
    title = f"{fitted.config.name}  ·  transfer function at {100.0 * reduction.share:.0f} % travel"
    style.title(fig, title, 0.11)
    style.legend(fig, [top, bottom], 0.11, 0.925, "upper left")
    style.caution(fig, state.cautions, 0.95)
    return fig


def _band(panel, values: np.ndarray, known: str) -> None:
    low, high = np.quantile(values, (0.025, 0.975), axis=0)
    panel.fill_between(_HERTZ, low, high, color=style.SIMULATED, alpha=0.25, lw=0, label=known)


_LETTERS = 11.5  # letters of a sentence per inch
_DENSE = 300  # points of a computed line


def draw_sines(config: RigConfig, response: FrequencyResponse) -> Figure:
    """The loop on the left; if a drive was logged, the plant on the right."""
    driven = any(point.plant is not None for point in response.points)
    columns = 2 if driven else 1
    wide, tall = (13.2 if driven else 9.0), 8.6
    fig = style.figure(wide, tall, config.synthetic)
    grid = fig.subplots(3, columns, sharex=True, squeeze=False, gridspec_kw={"height_ratios": (1.0, 1.0, 0.45)})
    fig.subplots_adjust(left=0.95 / wide, right=1.0 - 0.15 / wide, top=1.0 - 1.5 / tall, bottom=0.55 / tall,
                        hspace=0.13, wspace=0.24)  # fmt: skip
    _loop(list(grid[:, 0]), response)
    if driven:
        _plant(list(grid[:, 1]), response)
    low, high = response.frequencies[0] / 1.15, response.frequencies[-1] * 1.15
    for column in grid.T:
        for panel in column[:2]:
            style.quiet_axis(panel)
        column[1].set_ylabel("phase [deg]")
        column[2].set_xlabel("frequency [Hz]")
        column[2].set_xscale("log")
        column[2].set_xlim(low, high)
        style.log_ticks(column[2].xaxis, (low, high))
    grid[0, 0].figure.align_ylabels(list(grid[:, 0]))
    style.title(fig, f"{config.name}  ·  response to sines", 0.95 / wide)
    style.legend(fig, list(grid[0]), 0.95 / wide, 1.0 - 0.45 / tall, "upper left", most=2 * columns)
    said = f"Order of lag of the loop: {response.order.says}" + (" " + _UNDER if driven else "")
    fig.text(
        0.95 / wide, 1.0 - 0.72 / tall, textwrap.fill(said, int(_LETTERS * wide)), ha="left", va="top", fontsize=10
    )
    return fig


def _loop(panels: Sequence[Axes], response: FrequencyResponse) -> None:
    points = response.points
    _measured(panels, points, [point.closed_loop for point in points])
    _modelled(panels, response, response.loops_around(response.nonlinear), response.loops_around(response.linear_plant))
    _lag(panels, response.frequencies, response.order)
    _outside(panels[2], points, POSITION)
    swings = np.degrees([abs(point.waves.amplitudes[SETPOINT][0]) for point in points])
    even = np.ptp(swings) < 0.05 * swings.max()
    size = f"±{swings.max():.2g}°" if even else f"±{swings.min():.2g} … {swings.max():.2g}°"
    place = f"{size} about {100.0 * response.share:.0f} % travel"
    panels[0].set_title(f"loop: setpoint ({place}) → position", loc="left")
    panels[0].set_ylabel("magnitude [dB]")
    panels[2].set_ylabel("position: power\noutside sine [%]")


def _plant(panels: Sequence[Axes], response: FrequencyResponse) -> None:
    points = [point for point in response.points if point.plant is not None]
    _measured(panels, points, [point.plant for point in points if point.plant is not None])
    _modelled(panels, response, response.nonlinear, ())
    dense = np.geomspace(response.frequencies[0], response.frequencies[-1], _DENSE)
    value = response.linear(2j * np.pi * dense)
    _line(panels, dense, list(value), color=style.READING, ls="--", label=_LINEAR)
    _outside(panels[2], points, DRIVE)
    panels[0].set_title("plant: voltage → position", loc="left")
    panels[0].set_ylabel("magnitude [dB re 1 rad/V]")
    panels[2].set_ylabel("voltage: power\noutside sine [%]")


_UNDER = "Both models of the loop are under the ECU as these traces show it."
_NONLINEAR = "fitted model, run free on the logged drive"
_LINEAR = "linear third order, without dry friction"


def _measured(panels: Sequence[Axes], points: Sequence[Point], ratios: Sequence[Ratio]) -> None:
    hertz = np.array([point.frequency for point in points])
    ends = 20.0 * np.log10(np.array([ratio.magnitude_ci95 for ratio in ratios]))
    middle = 20.0 * np.log10([ratio.magnitude for ratio in ratios])
    look = {"fmt": "o", "ms": 5.5, "color": style.MEASURED, "capsize": 3, "lw": 1.2, "label": "measured, 95 % interval",
            "zorder": 4}  # fmt: skip
    panels[0].errorbar(hertz, middle, np.abs(ends - middle[:, None]).T, **look)
    margins = np.degrees([ratio.phase_margin for ratio in ratios])
    panels[1].errorbar(hertz, np.degrees(phases([ratio.value for ratio in ratios])), margins, **look)


def _modelled(
    panels: Sequence[Axes],
    response: FrequencyResponse,
    nonlinear: Sequence[complex | None],
    linear: Sequence[complex | None],
) -> None:
    hertz = response.frequencies
    _line(panels, hertz, nonlinear, color=style.SIMULATED, ls="-", label=_NONLINEAR)
    _line(panels, hertz, linear, color=style.READING, ls="--", label=_LINEAR)


def _line(panels: Sequence[Axes], hertz: np.ndarray, values: Sequence[complex | None], **look: Any) -> None:
    sizes = np.array([np.nan if value is None else abs(value) for value in values])
    if np.any(np.isfinite(sizes)):
        panels[0].plot(hertz, 20.0 * np.log10(sizes), **look)
        panels[1].plot(hertz, np.degrees(phases(values)), **look)


def _lag(panels: Sequence[Axes], hertz: np.ndarray, order: Order) -> None:
    if order.best is None or not order.is_certain:
        return
    dense = np.geomspace(hertz[0], hertz[-1], _DENSE)
    name = f"lag of order {order.best.order}" + (f" and {1e3 * order.best.delay:.2g} ms" if order.best.delayed else "")
    _line(panels, dense, list(order.best(2j * np.pi * dense)), color=style.UNKNOWN, ls=":", label=name)


def _outside(panel: Axes, points: Sequence[Point], name: str) -> None:
    hertz = np.array([point.frequency for point in points])
    panel.plot(hertz, [100.0 * point.waves.outside[name] for point in points], "o-", ms=4, lw=1.0, color=style.MEASURED)
    panel.set_ylim(bottom=0.0)
