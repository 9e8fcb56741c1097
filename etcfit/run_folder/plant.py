"""transfer_function.json and frequency_response.json, declared: the linear plant of `control`.

`api.work` calls it and writes the files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..control.frequency import FrequencyResponse, Lag, Ratio, phases
from ..control.frequency.response import DRIVE, POSITION, SETPOINT
from ..control.linearise import INPUTS, SYMBOLS, UNITS, Reduction
from ..estimation.fitted_model import Fitted
from .declared import WARNINGS, Key, Record, by_name, file_of, key, list_of


def reduction_json(fitted: Fitted, reduction: Reduction, pade_order: int) -> dict[str, Any]:
    """The object of transfer_function.json."""
    return TRANSFER_FUNCTION.json({"fitted": fitted, "reduction": reduction, "pade_order": pade_order})


def _appended(of: Mapping[str, Any]) -> dict[str, Any] | None:
    if not of["pade_order"]:
        return None
    appended = of["reduction"].to_control(of["pade_order"])
    return {"pade_order": of["pade_order"], "num": appended.num[0][0].tolist(), "den": appended.den[0][0].tolist()}


INPUT = Record(
    name=key("text", "voltage or duty.", lambda reduction: INPUTS[reduction.input_unit]),
    unit=key("text", "V or %.", "input_unit"),
)  # fmt: skip
OUTPUT = Record(
    name=key("text", "position.", lambda _: "position"),
    unit=key("text", "rad, deg or %.", "output_unit"),
)  # fmt: skip
OPERATING_POINT = Record(
    position_rad=key("number?", "Angle.", "theta"),
    position_pct=key("number?", "The same, per cent of the travel.", "share", scale=100.0),
    voltage_V=key("number?", "That holds it in the middle of the dry friction.", "volts"),
    current_A=key("number?", "That holds it.", "current"),
)  # fmt: skip
STDERR = Record(
    num=key("[number?]", "As num.", lambda reduction: [reduction.stderr[0]]),
    den=key("[number?]", "As den; the leading 1 has none, 0.",
        lambda reduction: [0.0, *reduction.stderr[1:].tolist()]),
)  # fmt: skip
WITH_DELAY_AND_LAG = Record(
    pade_order=key("whole", "Order of the approximated delay."),
    num=key("[number]", "Numerator."),
    den=key("[number]", "Denominator."),
)  # fmt: skip
_MEANING = {"kS": "Dry friction, V.", "kV": "Back-EMF and drag, V s/rad.", "kA": "Inertia, V s^2/rad."}


def _three(attribute: str) -> dict[str, Key]:
    """kS, kV and kA, taken from an array of three."""
    return {
        symbol: key("number", _MEANING[symbol], lambda found, k=k: float(getattr(found, attribute)[k]))
        for k, symbol in enumerate(SYMBOLS)
    }


FEEDFORWARD = Record(
    **_three("values"),
    stderr=key(Record(**_three("stderr")), "Standard errors of the three, by the delta method.", ""),
    unit=key(
        Record(**{s: key("text", f"Of {s}.", lambda _, own=own: own) for s, own in zip(SYMBOLS, UNITS, strict=True)}),
        "Unit of each.", "",
    ),
)  # fmt: skip
TRANSFER_FUNCTION = file_of(
    "The linear plant about an operating point: written by `etcfit reduce`.",
    "fitted.config", "fitted",
    **Record(
        input=key(INPUT, "The input.", ""),
        output=key(OUTPUT, "The output.", ""),
        operating_point=key(OPERATING_POINT, "Where the plate is held.", ""),
        num=key("[number]", "Numerator [b0].", "plant.num", minItems=1, maxItems=1),
        den=key("[number]", "Denominator [1, a2, a1, a0], highest power of s first.", "plant.den",
            minItems=4, maxItems=4),
        poles=key("[[number]]", "Each [real, imaginary], 1/s.",
            lambda reduction: [[float(p.real), float(p.imag)] for p in reduction.plant.poles],
            each={"minItems": 2, "maxItems": 2}),
        stderr=key(STDERR, "Standard errors of the coefficients.", ""),
        feedforward=key(FEEDFORWARD, "v = kS sgn(w) + kV w + kA dw/dt, w the speed of the shaft whose angle was "
            "logged: the constants of robots' feed-forwards.", "constants", null=True, optional=True),
        open_loop_dc_gain=key("number?", "Static gain, output unit over input unit.", "plant.dc_gain"),
        delay_s=key("number?", "Delay of the input found by the diagnosis; not in num and den.", "plant.delay"),
        sensor_lag_s=key("number?", "Time constant of the position sensor; not in num and den.", "plant.lag"),
    ).within("reduction"),
    with_delay_and_lag=key(WITH_DELAY_AND_LAG, "The same with delay and sensor lag appended, where `--pade` asked for "
        "it; else null.", _appended, null=True),
)  # fmt: skip


def frequency_json(fitted: Fitted, response: FrequencyResponse) -> dict[str, Any]:
    """The object of frequency_response.json.

    Phases are unwrapped from one frequency to the next and negative where the first lags; null is what was not logged.
    `measured` has position over setpoint, position over drive, and drive over setpoint - position; `modelled` the same
    plant of the fitted model (run free on the logged drive, and linear) and the loops that the ECU would make of them.
    """
    return FREQUENCY_RESPONSE.json({"fitted": fitted, "response": response})


def _points(response: FrequencyResponse) -> list[dict[str, Any]]:
    measured = {
        "closed_loop": [point.closed_loop for point in response.points],
        "plant": response.plants,
        "controller": [point.controller for point in response.points],
    }
    modelled = {
        "nonlinear_plant": response.nonlinear,
        "linear_plant": response.linear_plant,
        "nonlinear_closed_loop": response.loops_around(response.nonlinear),
        "linear_closed_loop": response.loops_around(response.linear_plant),
    }
    columns = {name: _measured(ratios) for name, ratios in measured.items()}
    lines = {name: _modelled(values) for name, values in modelled.items()}
    return [
        {
            "point": point,
            "measured": {name: column[k] for name, column in columns.items()},
            "modelled": {name: line[k] for name, line in lines.items()},
        }
        for k, point in enumerate(response.points)
    ]


def _measured(ratios: Sequence[Ratio | None]) -> list[dict[str, Any] | None]:
    angles = phases([ratio and ratio.value for ratio in ratios])
    return [ratio and {"magnitude": ratio.magnitude, "magnitude_ci95": ratio.magnitude_ci95, "phase_rad": angle,
                       "phase_ci95_rad": [angle - ratio.phase_margin, angle + ratio.phase_margin]}
            for ratio, angle in zip(ratios, angles, strict=True)]  # fmt: skip


def _modelled(values: Sequence[complex | None]) -> list[dict[str, Any] | None]:
    return [None if value is None else {"magnitude": abs(value), "phase_rad": angle}
            for value, angle in zip(values, phases(values), strict=True)]  # fmt: skip


def _singles(lag: Lag) -> int:
    """Place of the first single lag among the standard errors: gain, delay, a corner and a damping for each pair."""
    return 2 + 2 * (lag.order // 2)


RATIO = Record(
    "Magnitude and phase.", "ratio",
    magnitude=key("number?", "Ratio of amplitudes."),
    magnitude_ci95=key("[number?]?", "95 % interval; of measured ratios only.", optional=True),
    phase_rad=key("number?", "Negative where the output lags; continuous from one frequency to the next."),
    phase_ci95_rad=key("[number?]?", "95 % interval; of measured ratios only.", optional=True),
)  # fmt: skip
POINT = Record(
    "One frequency.",
    file=key("text", "The trace.", "point.measurement.file"),
    held_out=key("flag", "It was not fitted.", "point.measurement.held_out"),
    frequency_Hz=key("number", "Of the setpoint's sine.", "point.frequency"),
    cycles=key("number?", "Cycles evaluated.", "point.window.cycles"),
    cycles_left_out=key("number?", "Cycles left out at the beginning, until the motion had settled.",
        "point.window.skipped"),
    position_mean_rad=key("number?", "About which it moves.", lambda at: at["point"].waves.offsets[POSITION]),
    position_amplitude_rad=key("number?", "Of the fundamental.", "point.amplitude"),
    setpoint_amplitude_rad=key("number?", "Of the fundamental.",
        lambda at: abs(at["point"].waves.amplitudes[SETPOINT][0])),
    outside_fundamental=key("{number?}", "By signal: share of the motion that is no sine of this frequency.",
        lambda at: {name: at["point"].waves.outside.get(name) for name in (SETPOINT, POSITION, DRIVE)}),
    position_harmonics=key("number?", "Share that lies in harmonics.",
        lambda at: at["point"].waves.in_harmonics[POSITION]),
    position_noise=key("number?", "Share that is noise.", "point.noise"),
    measured=key(by_name(RATIO, null=True), "closed_loop (position over setpoint), plant (position over drive), "
        "controller (drive over setpoint - position); null is what was not logged."),
    modelled=key(by_name(RATIO, null=True), "nonlinear_plant (the fitted model run free on the logged drive), "
        "linear_plant, and the loops that the ECU would make of them."),
)  # fmt: skip
LAG_STDERR = Record(
    ln_gain=key("number?", "Of the logarithm of the gain.", lambda lag: lag.stderr[0]),
    delay_s=key("number?", "Of the delay.", lambda lag: lag.stderr[1] if lag.delayed else None),
    ln_corners=key("[number?]", "Of the logarithms of the corners.",
        lambda lag: [*lag.stderr[2 : _singles(lag) : 2], *lag.stderr[_singles(lag) :]]),
    damping=key("[number?]", "Of the dampings.",
        lambda lag: [*lag.stderr[3 : _singles(lag) : 2], *([None] * (lag.order % 2))]),
)  # fmt: skip
LAG = Record(
    "One lag.",
    order=key("whole", "Of it."),
    gain=key("number?", "Static gain."),
    delay_s=key("number?", "Delay; null where it has none.", lambda lag: lag.delay if lag.delayed else None),
    corners_Hz=key("[number?]", "Corner frequencies.", lambda lag: np.array(lag.corners) / (2.0 * np.pi)),
    damping=key("[number?]", "Of each pair; null of a single lag.",
        lambda lag: [*lag.damping, *([None] * (lag.order % 2))]),
    stderr=key(LAG_STDERR, "Standard errors.", ""),
    unexplained=key("number?", "Scatter beyond the measurement's own.", "tau"),
    aicc=key("number?", "Akaike's criterion, corrected for few points."),
)  # fmt: skip
ORDER = Record(
    told=key("flag", "The frequencies can tell the order.", "is_certain"),
    says=key("text", "In words."),
    order=key("whole?", "The order; null where unknown.",
        lambda found: found.best.order if found.best is not None and found.is_certain else None),
    weights=key("{number?}", "By order: Akaike weight."),
    candidates=key(list_of(LAG), "Each lag that was fitted."),
)  # fmt: skip
_LAGS = key(ORDER, "How many lags the frequency response looks like; null where there is nothing to judge.", null=True)
ORDERS = Record(closed_loop=_LAGS.taken_from("order"), plant=_LAGS.taken_from("plant_order"))
LINEAR = Record(
    num=key("[number]", "As in transfer_function.json.", "linear.num"),
    den=key("[number]", "Likewise.", "linear.den"),
    delay_s=key("number?", "Delay.", "linear.delay"),
    sensor_lag_s=key("number?", "Sensor lag.", "linear.lag"),
    position_pct=key("number?", "Operating point, per cent of the travel.", "share", scale=100.0),
)  # fmt: skip
FREQUENCY_RESPONSE = file_of(
    "What sine traces say, beside the fitted and the linear model: written by `etcfit reduce` where the rig has sine "
    "traces.",
    "fitted.config", "fitted",
    units=key("{text}", "Units of the magnitudes and of the phase.",
        lambda _: {"closed_loop": "1", "plant": "rad/V", "controller": "V/rad", "phase": "rad"}),
    **Record(
        points=key(list_of(POINT), "One for each sine trace, by frequency.", _points),
        order=key(ORDERS, "Order of lag.", ""),
        linear=key(LINEAR, "The linear plant that was compared.", ""),
        warnings=WARNINGS,
        settings=key("object", "Which traces count, and when their points tell an order of lag: every field of "
            "`etcfit.FrequencySettings`."),
    ).within("response"),
)  # fmt: skip
