"""transfer_function.json."""

from __future__ import annotations

from typing import Any

from ..control.linearise import INPUTS, SYMBOLS, UNITS, MotorConstants, Reduction
from ..estimation.fitted_model import Fitted
from ..files import plain
from .fit import versions


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
