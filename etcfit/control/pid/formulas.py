"""Tuning rules that are formulas of the transfer function. A new rule joins `FORMULAS` and `pid.RULES`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ...model.linear import TransferFunction
from ...model.pid import Gains
from .base import Refusal, Rule, Task

_SCAN = np.geomspace(1e-2, 1e5, 4000)  # rad/s


@dataclass(frozen=True)
class Ultimate:
    """Ultimate gain (V/rad) and period (s)."""

    gain: float
    period: float


def ultimate(plant: TransferFunction, late: float = 0.0) -> Ultimate | Refusal:
    """Gain and period where the phase of the plant first passes -180 degrees: K_u = 1/|G(j w_u)|, P_u = 2 pi / w_u.

    Without lag and delay w_u = sqrt(a1) and K_u = (a2 a1 - a0) / b0 (Routh).

    Args:
        plant: rad/V.
        late: further delay, for example of an ECU's hold, s.
    """
    swing = np.unwrap(np.angle(plant.bare()(1j * _SCAN)))
    phase = swing - np.arctan(plant.lag * _SCAN) - (plant.delay + late) * _SCAN
    beyond = np.flatnonzero(phase < -math.pi)
    if beyond.size == 0 or beyond[0] == 0:
        return Refusal("the plant's phase never passes -180 degrees: it has no ultimate gain")

    def beyond_180(w: float) -> float:
        value = plant(1j * w) * np.exp(-1j * w * late)
        return float((np.angle(value) + 2.0 * math.pi) % (2.0 * math.pi) - math.pi)

    k = int(beyond[0])
    w = float(brentq(beyond_180, _SCAN[k - 1], _SCAN[k], xtol=1e-13, rtol=1e-14))  # type: ignore[arg-type]
    return Ultimate(1.0 / abs(complex(plant(1j * w))), 2.0 * math.pi / w)


def from_ultimate(u: Ultimate) -> Gains:
    """Kp = 0.6 K_u, Ti = P_u / 2, Td = P_u / 8."""
    return Gains.standard(0.6 * u.gain, u.period / 2.0, u.period / 8.0)


def ziegler_nichols(task: Task) -> Gains | Refusal:
    """Kp = 0.6 K_u, Ki = 2 Kp / P_u, Kd = Kp P_u / 8, from the transfer function: the start of the paper's tuning.

    Source: Ziegler and Nichols 1942, Trans. ASME 64; the paper, section 4.2. Differs from source: K_u and P_u are
    computed from the transfer function, with half the ECU's period as delay, not found by raising a gain on the rig.
    """
    u = ultimate(task.plant, task.ecu.late)
    return u if isinstance(u, Refusal) else from_ultimate(u)


def tyreus_luyben(task: Task) -> Gains | Refusal:
    """Kp = K_u / 2.2, Ti = 2.2 P_u, Td = P_u / 6.3: Ziegler and Nichols' with far less integral action.

    Source: Luyben and Luyben 1997, Essentials of Process Control, ch. 3. Luyben 1996, Ind. Eng. Chem. Res. 35(10), has
    0.46 K_u, later textbooks 0.45; Tyreus and Luyben 1992, ibid. 31(11), gives the PI settings alone. Differs from
    source: half the ECU's period counts as delay.
    """
    u = ultimate(task.plant, task.ecu.late)
    return u if isinstance(u, Refusal) else Gains.standard(u.gain / 2.2, 2.2 * u.period, u.period / 6.3)


def simc(task: Task) -> Gains | Refusal:
    """Kc = T1 / (k (Tc + L)), Ti = min(T1, 4 (Tc + L)), Td = T2 in series form, with Tc = L ("tight").

    The plant becomes k exp(-L s) / ((T1 s + 1) (T2 s + 1)) by the half rule: of its time constants T1 > t2 > t3 and the
    sensor's lag, T2 = t2 + t3 / 2 and L = delay + t3 / 2 + the rest.

    Source: Skogestad 2003, J. Process Control 13(4). Differs from source: the time constant of a complex pole is
    1 / |pole|; half the ECU's period and the whole lag of its derivative count as delay, because with Tc = L neither is
    negligible.
    """
    plant = task.plant
    times = sorted((*(1.0 / np.abs(plant.poles)), plant.lag), reverse=True)
    if not np.isfinite(plant.dc_gain) or not np.all(plant.poles.real < 0.0):
        return Refusal("the plant has no spring: SIMC's rule for a lag does not apply")
    T1, t2, t3, *rest = times
    T2 = t2 + 0.5 * t3
    L = plant.delay + task.ecu.late + task.ecu.derivative_late + 0.5 * t3 + sum(rest)
    return Gains.series(T1 / (plant.dc_gain * 2.0 * L), min(T1, 8.0 * L), T2)


def amigo(task: Task) -> Gains | Refusal:
    """Kp = (0.2 + 0.45 T/L) / K, Ti = L (0.4 L + 0.8 T) / (L + 0.1 T), Td = 0.5 L T / (0.3 L + T).

    The plant becomes K exp(-L s) / (T s + 1): L where the steepest tangent of its step response crosses zero, L + T
    where the response reaches 63 % of its end.

    Source: Astrom and Hagglund 2004, J. Process Control 14(6). Differs from source: setpoint weight 1, and half the
    ECU's period counts as delay.
    """
    plant = task.plant
    if not np.isfinite(plant.dc_gain) or not np.all(plant.poles.real < 0.0):
        return Refusal("the plant has no spring: its step response has no final value")
    T, L = first_order(plant)
    L += plant.delay + plant.lag + task.ecu.late
    kp = (0.2 + 0.45 * T / L) / plant.dc_gain
    return Gains.standard(kp, L * (0.4 * L + 0.8 * T) / (L + 0.1 * T), 0.5 * L * T / (0.3 * L + T))


def first_order(plant: TransferFunction) -> tuple[float, float]:
    """Time constant T and apparent delay L of the plant's step response, s."""
    slowest = 1.0 / float(np.min(-plant.poles.real))
    fastest = 1.0 / float(np.max(np.abs(plant.poles)))
    time = np.concatenate((np.linspace(0.0, 60.0 * fastest, 3000, endpoint=False),
                           np.geomspace(60.0 * fastest, max(12.0 * slowest, 70.0 * fastest), 6000)))  # fmt: skip
    y = _step(plant, time)
    slope = np.gradient(y, time)
    k = int(np.argmax(slope))
    L = max(time[k] - y[k] / slope[k], 0.0)
    reached = int(np.argmax(y >= (1.0 - np.exp(-1.0)) * plant.dc_gain))
    return float(time[reached] - L), float(L)


def _step(plant: TransferFunction, time: np.ndarray) -> np.ndarray:
    """Step response by partial fractions, at any instants (s)."""
    from scipy.signal import residue

    r, p, _ = residue(plant.num, (*plant.den, 0.0))
    return np.real(np.exp(np.outer(time, p)) @ r)


D = 0.5  # each double ratio a_k a_(k-2) / a_(k-1)^2: damping 0.7 at about 6 % overshoot
SETTLES = 6.0  # required settling time over Te
DAMPED = 0.7  # largest Te, over the Te at which the damping of the back-EMF alone is enough and Kd would be 0


def damping_optimum(task: Task) -> Gains | Refusal:
    """The closed loop's polynomial made D2^3 D3^2 D4 Te^4 s^4 + D2^2 D3 Te^3 s^3 + D2 Te^2 s^2 + Te s + 1.

    With the plant b0 / (s^3 + a2 s^2 + a1 s + a0) its coefficients are those of s^4 + a2 s^3 + (a1 + b0 Kd) s^2 +
    (a0 + b0 Kp) s + b0 Ki. D2 = D3 = 1/2, and D4 follows from Te; Te is a sixth of the required settling time, less
    where the motor's own damping is large (`DAMPED`), and at least 8 / a2, where D4 = 1/2.

    Source: Deur, Pavkovic, Peric, Jansz and Hrovat 2004, IEEE Trans. Ind. Appl. 40(3), section III. Differs from
    source: the armature is not neglected, the loop is not sampled, and Te is taken from the requirement.
    """
    plant = task.plant
    damped = DAMPED * plant.a2 / (D**2 * plant.a1)
    te = max(1.0 / (D**3 * plant.a2), min(task.requirements.settling_s / SETTLES, damped))
    # s^4 has coefficient 1: divide by D2^3 D3^2 D4 Te^4, in which D4 = 1 / (D2 D3 Te a2)
    ki = plant.a2 / (D**3 * te**3)
    kp, kd = ki * te - plant.a0, ki * D * te**2 - plant.a1
    if min(kp, kd) < 0.0:
        return Refusal("the plant is already faster than the required settling time")
    return Gains(kp / plant.b0, ki / plant.b0, kd / plant.b0)


def as_found(task: Task) -> Gains | Refusal:
    """Kp, Ki, Kd as [ecu] of rig.toml states them or the fit found them.

    Source: the rig's own logs (`effects.controller`). Differs from source: they are tried in the task's ECU, whose
    clock, delay and bias curve may be different.
    """
    return task.as_found


FORMULAS: tuple[Rule, ...] = (ziegler_nichols, tyreus_luyben, simc, amigo, damping_optimum, as_found)
