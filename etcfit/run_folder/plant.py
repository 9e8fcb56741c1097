"""Makes the contents of transfer_function.json and frequency_response.json, the linear plant of `control`.

`api.work` calls it and writes the files.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..control.frequency import FrequencyResponse, Lag, Order, Ratio, phases
from ..control.frequency.response import DRIVE, POSITION, SETPOINT
from ..control.linearise import INPUTS, SYMBOLS, UNITS, MotorConstants, Reduction
from ..estimation.fitted_model import Fitted
from ..files import plain
from .shared import versions


def reduction_json(fitted: Fitted, reduction: Reduction, pade_order: int) -> dict[str, Any]:
    """The object of transfer_function.json (docs/formats.md), and what else a reader may want to know.

    Args:
        fitted: the model.
        reduction: of it.
        pade_order: of the approximated delay in `with_delay_and_lag`; 0 leaves that out.
    """
    plant, unit = reduction.plant, reduction.output_unit
    extra = None
    if pade_order:
        appended = reduction.to_control(pade_order)
        extra = {"pade_order": pade_order, "num": appended.num[0][0].tolist(), "den": appended.den[0][0].tolist()}
    return plain({
        "rig": fitted.config.name,
        "synthetic": fitted.config.synthetic,
        "model": {"effects": [effect.name for effect in fitted.free_parameters.layout.types]},
        "fit": fitted.state,
        "input": {"name": INPUTS[reduction.input_unit], "unit": reduction.input_unit},
        "output": {"name": "position", "unit": unit},
        "operating_point": {
            "position_rad": reduction.theta, "position_pct": 100.0 * reduction.share,
            "voltage_V": reduction.volts, "current_A": reduction.current,
        },
        "num": list(plant.num),
        "den": list(plant.den),
        "poles": [[float(p.real), float(p.imag)] for p in plant.poles],
        "stderr": {"num": [reduction.stderr[0]], "den": [0.0, *reduction.stderr[1:].tolist()]},
        "feedforward": _constants(reduction.constants),
        "open_loop_dc_gain": plant.dc_gain,
        "delay_s": plant.delay,
        "sensor_lag_s": plant.lag,
        "with_delay_and_lag": extra,
        "versions": versions(),
    })  # fmt: skip


def _constants(found: MotorConstants | None) -> dict[str, Any] | None:
    """kS, kV and kA; null where nobody asked for them."""
    if found is None:
        return None
    return {**dict(zip(SYMBOLS, found.values.tolist(), strict=True)),
            "stderr": dict(zip(SYMBOLS, found.stderr.tolist(), strict=True)),
            "unit": dict(zip(SYMBOLS, UNITS, strict=True))}  # fmt: skip


def frequency_json(fitted: Fitted, response: FrequencyResponse) -> dict[str, Any]:
    """The object of frequency_response.json.

    Phases are unwrapped from one frequency to the next and negative where the first lags; null is what was not logged.
    `measured` has position over setpoint, position over drive, and drive over setpoint - position; `modelled` the same
    plant of the fitted model (run free on the logged drive, and linear) and the loops that the ECU would make of them.
    """
    points, linear = response.points, response.linear
    measured = {
        "closed_loop": [point.closed_loop for point in points],
        "plant": response.plants,
        "controller": [point.controller for point in points],
    }
    modelled = {
        "nonlinear_plant": response.nonlinear,
        "linear_plant": response.linear_plant,
        "nonlinear_closed_loop": response.loops_around(response.nonlinear),
        "linear_closed_loop": response.loops_around(response.linear_plant),
    }
    columns = {name: _measured(ratios) for name, ratios in measured.items()}
    lines = {name: _modelled(values) for name, values in modelled.items()}
    return plain({
        "rig": fitted.config.name,
        "synthetic": fitted.config.synthetic,
        "fit": fitted.state,
        "model": {"effects": [effect.name for effect in fitted.free_parameters.layout.types]},
        "units": {"closed_loop": "1", "plant": "rad/V", "controller": "V/rad", "phase": "rad"},
        "points": [
            {
                "file": point.measurement.file,
                "held_out": point.measurement.held_out,
                "frequency_Hz": point.frequency,
                "cycles": point.window.cycles,
                "cycles_left_out": point.window.skipped,
                "position_mean_rad": point.waves.offsets[POSITION],
                "position_amplitude_rad": point.amplitude,
                "setpoint_amplitude_rad": abs(point.waves.amplitudes[SETPOINT][0]),
                "outside_fundamental": {name: point.waves.outside.get(name) for name in (SETPOINT, POSITION, DRIVE)},
                "position_harmonics": point.waves.in_harmonics[POSITION],
                "position_noise": point.noise,
                "measured": {name: column[k] for name, column in columns.items()},
                "modelled": {name: line[k] for name, line in lines.items()},
            }
            for k, point in enumerate(points)
        ],
        "order": {"closed_loop": _order(response.order), "plant": _order(response.plant_order)},
        "linear": {"num": list(linear.num), "den": list(linear.den), "delay_s": linear.delay,
                   "sensor_lag_s": linear.lag, "position_pct": 100.0 * response.share},
        "warnings": list(response.warnings),
        "settings": response.settings,
        "versions": versions(),
    })  # fmt: skip


def _measured(ratios: Sequence[Ratio | None]) -> list[dict[str, Any] | None]:
    angles = phases([ratio and ratio.value for ratio in ratios])
    return [ratio and {"magnitude": ratio.magnitude, "magnitude_ci95": ratio.magnitude_ci95, "phase_rad": angle,
                       "phase_ci95_rad": [angle - ratio.phase_margin, angle + ratio.phase_margin]}
            for ratio, angle in zip(ratios, angles, strict=True)]  # fmt: skip


def _modelled(values: Sequence[complex | None]) -> list[dict[str, Any] | None]:
    return [None if value is None else {"magnitude": abs(value), "phase_rad": angle}
            for value, angle in zip(values, phases(values), strict=True)]  # fmt: skip


def _order(order: Order | None) -> dict[str, Any] | None:
    if order is None:
        return None
    return {
        "told": order.told,
        "says": order.says,
        "order": order.best.order if order.best is not None and order.told else None,
        "weights": {str(each): weight for each, weight in order.weights.items()},
        "candidates": [_lag(lag) for lag in order.candidates],
    }


def _lag(lag: Lag) -> dict[str, Any]:
    pairs = lag.order // 2
    return {
        "order": lag.order,
        "gain": lag.gain,
        "delay_s": lag.delay if lag.delayed else None,
        "corners_Hz": np.array(lag.corners) / (2.0 * np.pi),
        "damping": [*lag.damping, *([None] * (lag.order % 2))],
        "stderr": {
            "ln_gain": lag.stderr[0],
            "delay_s": lag.stderr[1] if lag.delayed else None,
            "ln_corners": [*lag.stderr[2 : 2 + 2 * pairs : 2], *lag.stderr[2 + 2 * pairs :]],
            "damping": [*lag.stderr[3 : 2 + 2 * pairs : 2], *([None] * (lag.order % 2))],
        },
        "unexplained": lag.tau,
        "aicc": lag.aicc,
    }
