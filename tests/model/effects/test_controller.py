"""The continuous controller against the discrete PID that it stands for, in closed form; its limit, and its silence."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from effect_samples import inputs
from etcfit.model.ecu import Ecu
from etcfit.model.effects import COMMANDING, EFFECTS, State
from etcfit.model.effects.controller import Controller
from etcfit.model.parameters import parameters_of
from etcfit.model.throttle import Throttle, followed
from etcfit.rig.controlled import NOMINAL
from etcfit.rig.ecu import GAINS

GAIN = {"K_p": 6.0, "K_i": 40.0, "K_d": 0.12}


def controller(period: float = 1e-3, delay: float = 0.0, limit: float = 1e6, **gains: float) -> Controller:
    fixed: Any = {"t_e": period, "tau_e": 2e-3, "t_l": delay, "V_e": limit}
    return Controller(**(GAIN | gains | fixed))


@jax.jit
def _slope(effect: Controller) -> Any:
    """Voltage and the memories' rates by angle, speed, setpoint, its rate and the memories, shape (4, 7)."""

    def parts(v: Any) -> Any:
        u = inputs(voltage=0.0, controlled=1.0, setpoint=v[2], setpoint_rate=v[3])
        c = effect(State(jnp.zeros(()), v[0], v[1]), tuple(v[4:]), u)
        return jnp.stack((c.voltage, *c.dz))

    return jax.jacfwd(parts)(jnp.zeros(7))


def continuous(effect: Controller, omega: float, angle: complex, setpoint: complex) -> complex:
    """Volts of the effect when angle and setpoint turn with e^(j omega t), by its own linearisation."""
    s, late, slope = 1j * omega, float(effect.t_l + 0.5 * effect.t_e), np.asarray(_slope(effect))
    drive = np.array([angle, s * angle, setpoint * np.exp(-s * late), s * setpoint])
    memory = np.linalg.solve(s * np.eye(3) - slope[1:, 4:], slope[1:, :4] @ drive)
    return complex(slope[0, :4] @ drive + slope[0, 4:] @ memory)


def discrete(effect: Controller, omega: float, error: complex) -> complex:
    """Fundamental of the held output of a PID that computes at every tick (its z transform, and that of a hold)."""
    period, filter_ = float(effect.t_e), float(effect.tau_e)
    back = np.exp(-1j * omega * period)
    pid = effect.K_p + effect.K_i * period / (1.0 - back)
    pid = pid + effect.K_d * (1.0 - back) / (filter_ + period - filter_ * back)
    hold = (1.0 - back) / (1j * omega * period)
    return complex(pid * hold * np.exp(-1j * omega * float(effect.t_l)) * error)


def worst(period: float, delay: float = 0.0, **gains: float) -> float:
    """Largest relative error up to 8 Hz, of the angle's part and of the setpoint's."""
    effect, out = controller(period, delay, **gains), []
    for omega in 2.0 * np.pi * np.array([0.5, 1.0, 2.0, 4.0, 8.0]):
        for angle, setpoint in ((1.0, 0.0), (0.0, 1.0)):
            wanted = discrete(effect, omega, setpoint - angle)
            out.append(abs(continuous(effect, omega, angle, setpoint) / wanted - 1.0))
    return max(out)


@pytest.mark.parametrize(("period", "error"), [(1e-3, 0.005), (2e-3, 0.009), (5e-3, 0.025), (1e-2, 0.07)])
def test_it_does_what_the_discrete_pid_does(period: float, error: float) -> None:
    """Up to 8 Hz, beyond which a plate under it hardly moves: what it is wrong by, and no less (docs say so)."""
    assert 0.3 * error < worst(period) < error


@pytest.mark.parametrize("gain", ["K_p", "K_i"])
def test_without_a_filter_its_error_falls_with_the_square_of_the_period(gain: str) -> None:
    alone = {symbol: (1.0 if symbol == gain else 0.0) for symbol in GAIN}
    assert worst(2e-3, **alone) < 0.3 * worst(4e-3, **alone)
    assert worst(2e-3, **alone) > 1e-6


def test_a_delay_is_a_delay() -> None:
    assert worst(1e-3, 2e-3) < 0.02
    without = controller(1e-3)
    assert abs(continuous(without, 50.0, 1.0, 0.0) / discrete(controller(1e-3, 2e-3), 50.0, -1.0) - 1.0) > 0.08


def rates(effect: Controller, theta: float, z: tuple[float, ...], **more: Any) -> Any:
    u = inputs(**({"voltage": 0.0, "controlled": 1.0, "setpoint": 1.0, "setpoint_rate": 0.0} | more))
    return effect(State(0.0, theta, 0.0), z, u)


def test_at_its_limit_the_integral_stands_still_unless_the_error_leads_back() -> None:
    effect = controller(limit=3.0)
    free, limited = rates(effect, 0.9, (0.0, 0.0, 0.0)), rates(effect, 0.0, (0.0, 0.0, 0.0))
    assert free.dz[0] == pytest.approx(40.0 * 0.1)
    assert (float(limited.voltage), float(limited.dz[0])) == (3.0, 0.0)
    back = rates(effect, 1.1, (9.0, 0.0, 0.0))
    assert float(back.voltage) == 3.0
    assert back.dz[0] == pytest.approx(-40.0 * 0.1)


def test_what_the_integral_held_at_first_is_the_voltage_in_the_batch() -> None:
    """So that an error of it is one of the input, which the whitening knows; it is not counted twice."""
    held = rates(controller(), 0.9, (0.0, 0.0, 0.0), voltage=2.0)
    plain = rates(controller(), 0.9, (0.0, 0.0, 0.0))
    assert float(held.voltage) == pytest.approx(float(plain.voltage))
    limited = rates(controller(limit=3.0), 0.0, (0.0, 0.0, 0.0), voltage=2.0)
    assert float(limited.voltage) == 1.0


@pytest.mark.parametrize("controlled", [None, 0.0])
def test_it_is_silent_where_it_drives_nothing(controlled: float | None) -> None:
    c = rates(controller(), 0.3, (2.0, 1.0, 1.0), controlled=controlled)
    assert_allclose([float(c.voltage), *(float(r) for r in c.dz)], 0.0)


class Shifted(Controller):
    """Not an ECU: a sensor that shows 0.1 rad more, and an effect that shows the voltage it is told."""

    commands = False
    z0 = ()

    def __call__(self, x: State, z: Any, u: Any) -> Any:
        from etcfit.model.effects import Contribution

        return Contribution(position=0.1, torque=u.voltage)


def test_it_reads_the_sensor_and_all_others_feel_its_voltage() -> None:
    values = {p.symbol: getattr(controller(), p.symbol) for p in parameters_of(Controller)}
    throttle = Throttle.build((Shifted, Controller), values)
    u = inputs(voltage=0.0, controlled=1.0, setpoint=1.0, setpoint_rate=0.0)
    sensed, own = throttle.parts(State(0.0, 0.8, 0.0), (0.0, 0.0, 0.0), u)
    assert float(own.voltage) == pytest.approx((6.0 + 0.5 * 40.0 * 1e-3) * 0.1)
    assert float(sensed.torque) == pytest.approx(float(own.voltage))


def test_it_is_no_candidate_and_its_memories_are_followed() -> None:
    assert [effect.name for effect in COMMANDING] == ["controller"]
    assert Controller not in EFFECTS
    assert Controller.name not in {e.name for e in EFFECTS}
    assert len(followed((*EFFECTS, *COMMANDING))) == len(Controller.z0)
    assert followed(EFFECTS) == ()


def test_every_parameter_is_a_gain_or_a_constant_of_the_ecu() -> None:
    symbols = {p.symbol for p in parameters_of(Controller)}
    assert symbols == {*GAINS.values(), *Ecu().constants}
    assert set(NOMINAL) == set(GAINS.values())
