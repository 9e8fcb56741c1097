"""Bode plot of the transfer function, with what delay and sensor lag do to it and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ...control.linearise import Reduction
from ...estimation.fitted_model import FitState, Fitted
from ...model.linear import TransferFunction
from .. import style

_HERTZ = np.geomspace(0.02, 500.0, 400)
_DRAWS = 300


@dataclass(frozen=True, eq=False)
class BodePicture:
    """What the plot shows.

    Args:
        rig: its name.
        plant: transfer function.
        draws: coefficients b0, a2, a1, a0 from their covariance, shape (D, 4).
        unit: output over input.
        share: of the travel at the operating point.
        state: of the fit.
        synthetic: the data were made up.
    """

    rig: str
    plant: TransferFunction
    draws: np.ndarray
    unit: str
    share: float
    state: FitState
    synthetic: bool

    @classmethod
    def of(cls, fitted: Fitted, reduction: Reduction) -> BodePicture:
        mean = np.array([*reduction.plant.num, *reduction.plant.den[1:]])
        rng = np.random.default_rng(0)
        # relative, so that coefficients of very different size share one covariance
        scale = np.where(mean == 0.0, 1.0, mean)  # a plant without a spring has a0 = 0, exactly
        spread = reduction.covariance / np.outer(scale, scale)
        variance, directions = np.linalg.eigh(spread)
        sd = np.sqrt(np.maximum(variance, 0.0))
        draws = mean * np.exp((rng.standard_normal((_DRAWS, 4)) * sd) @ directions.T)
        unit = f"{reduction.output_unit}/{reduction.input_unit}"
        shown = fitted.config.name, reduction.plant, draws, unit, reduction.share
        return cls(*shown, fitted.state, fitted.config.synthetic)


def draw(picture: BodePicture) -> Figure:
    """Magnitude above phase, over frequency in Hz."""
    fig = style.figure(10.0, 6.2, picture.synthetic)
    top, bottom = fig.subplots(2, 1, sharex=True)
    fig.subplots_adjust(left=0.11, right=0.97, top=0.86, bottom=0.09, hspace=0.1)
    s = 2j * np.pi * _HERTZ
    each = np.array([TransferFunction(*row)(s) for row in picture.draws.tolist()])
    known = "95 % interval" if picture.state.compromise is None else "range that subsets of the data give"
    _band(top, 20.0 * np.log10(np.abs(each)), known)
    _band(bottom, np.degrees(np.unwrap(np.angle(each), axis=1)), known)
    bare, whole = picture.plant.bare()(s), picture.plant(s)
    top.plot(_HERTZ, 20.0 * np.log10(np.abs(bare)), color=style.SIMULATED, label="third order")
    bottom.plot(_HERTZ, np.degrees(np.unwrap(np.angle(bare))), color=style.SIMULATED, label="third order")
    if picture.plant.delay or picture.plant.lag:
        late = f"with {1e3 * picture.plant.delay:.2g} ms delay, {1e3 * picture.plant.lag:.2g} ms sensor lag"
        top.plot(_HERTZ, 20.0 * np.log10(np.abs(whole)), "--", color=style.READING, label=late)
        bottom.plot(_HERTZ, np.degrees(np.unwrap(np.angle(whole))), "--", color=style.READING, label=late)
    bottom.axhline(-180.0, color="black", lw=0.8)
    top.set_ylabel(f"magnitude [dB re 1 {picture.unit}]")
    bottom.set_ylabel("phase [deg]")
    bottom.set_xlabel("frequency [Hz]")
    bottom.set_xscale("log")
    bottom.set_xlim(_HERTZ[0], _HERTZ[-1])
    bottom.set_ylim(-290.0, 10.0)
    bottom.set_yticks(np.arange(-270.0, 1.0, 90.0))
    style.log_ticks(bottom.xaxis, (_HERTZ[0], _HERTZ[-1]))
    style.quiet_axis(top)
    title = f"{picture.rig}  ·  transfer function at {100.0 * picture.share:.0f} % travel"
    fig.suptitle(title, x=0.11, y=0.985, ha="left", va="top", fontsize=13)
    style.legend(fig, [top, bottom], 0.11, 0.925, "upper left")
    style.caution(fig, picture.state.cautions, 0.95)
    return fig


def _band(panel, values: np.ndarray, known: str) -> None:
    low, high = np.quantile(values, (0.025, 0.975), axis=0)
    panel.fill_between(_HERTZ, low, high, color=style.SIMULATED, alpha=0.25, lw=0, label=known)
