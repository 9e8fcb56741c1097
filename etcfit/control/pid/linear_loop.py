"""The ECU around the linear plant: no friction, no stops, no limit of the output."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...model.ecu import Ecu
from ...model.linear import TransferFunction
from .gains import Gains
from .setpoint import Setpoint

PADE_ORDER = 3
_GONE = 1e6  # a response beyond this many travels has gone


def respond(plant: TransferFunction, gains: Gains, ecu: Ecu, setpoint: Setpoint) -> np.ndarray:
    """Response in the setpoint's own unit at each tick, shape (K,); NaN once an unstable loop has gone.

        C(z) = Kp + Ki T z / (z - 1) + Kd (z - 1) / ((T_f + T) z - T_f)

    The plant is sampled with a hold; its delay and the ECU's enter by a Pade approximation of order 3. It starts at
    rest at the first value of the setpoint.
    """
    import control

    wanted = setpoint.at(setpoint.instants(ecu.period))
    rest = setpoint.shares[0]
    change: Any = wanted - rest
    loop = controller(gains, ecu) * sampled(plant, ecu)
    with np.errstate(all="ignore"):
        y = control.forced_response(control.feedback(loop, 1), inputs=change).outputs
    return rest + np.where(np.maximum.accumulate(np.abs(y)) < _GONE, y, np.nan)


def controller(gains: Gains, ecu: Ecu) -> Any:
    """C(z), a python-control state space."""
    import control

    T, Tf = ecu.period, ecu.filter
    integral = control.tf([gains.Ki * T, 0.0], [1.0, -1.0], T)
    derivative = control.tf([gains.Kd, -gains.Kd], [Tf + T, -Tf], T)
    return control.ss(control.tf([gains.Kp], [1.0], T)) + control.ss(integral) + control.ss(derivative)


def sampled(plant: TransferFunction, ecu: Ecu) -> Any:
    """The plant as the ECU's clock sees it, a python-control state space."""
    import control

    late = replace(plant, delay=plant.delay + ecu.delay)
    extra = late.delay > 0.0 or late.lag > 0.0
    return control.sample_system(control.ss(late.to_control(PADE_ORDER if extra else 0)), ecu.period, "zoh")
