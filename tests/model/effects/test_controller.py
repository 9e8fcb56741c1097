"""The ECU in the model against a PID written out in plain numbers; what it holds, reads and leaves alone."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from effect_samples import inputs
from etcfit.model.ecu import Ecu
from etcfit.model.effects import COMMANDING, EFFECTS, AbstractEffect, Contribution, State
from etcfit.model.effects.controller import Controller
from etcfit.model.parameters import parameters_of
from etcfit.model.throttle import Throttle, followed
from etcfit.rig.driven import NOMINAL_GAINS
from etcfit.rig.ecu import GAINS

GAIN = {"K_p": 6.0, "K_i": 40.0, "K_d": 0.12}


def controller(
    period: float = 1e-3, delay: float = 0.0, limit: float = 1e6, hold: float = 0.0, **gains: float
) -> Controller:
    ecu = Ecu(period, limit, delay=delay, integral=hold / limit)
    return Controller(**(GAIN | ecu.constants | gains))  # pyright: ignore[reportArgumentType]


def run(effect: Controller, setpoint: np.ndarray, angle: np.ndarray, speed: np.ndarray, v_0: float = 0.0) -> np.ndarray:
    """Volts held after each of its ticks, its angle's delay followed in steps of a hundredth of a period."""
    period, between = float(effect.t_e), 100 if float(effect.t_l) else 0

    def tick(z: Any, entry: Any) -> Any:
        wanted, theta, omega, time = entry
        x, u = State(0.0, theta, omega), inputs(voltage=v_0, controlled=1.0, setpoint=wanted, time=time)
        z = effect.ticked(x, z, u)
        volts = v_0 + effect(x, z, u).voltage

        def drift(_: Any, z: Any) -> Any:
            return tuple(each + 0.01 * period * rate for each, rate in zip(z, effect(x, z, u).dz, strict=True))

        return jax.lax.fori_loop(0, between, drift, z), volts

    first = tuple(jnp.asarray(each, dtype=float) for each in Controller.z0)
    entries = (setpoint, angle, speed, period * np.arange(len(setpoint)))
    return np.asarray(jax.lax.scan(tick, first, tuple(map(jnp.asarray, entries)))[1])


def written_out(error: np.ndarray, period: float, limit: float, v_0: float, hold: float) -> np.ndarray:
    """The PID of `independent.kernel.run_loop`, from a filtered error that begins as the error; what the integral held
    at first counts for its own limit."""
    area, smooth, out = 0.0, error[0], []
    for miss in error:
        chase = (miss - smooth) / (2e-3 + period)
        smooth += period * chase
        if hold:
            area = (min(max(v_0 + GAIN["K_i"] * (area + period * miss), -hold), hold) - v_0) / GAIN["K_i"]
            volts = v_0 + GAIN["K_p"] * miss + GAIN["K_i"] * area + GAIN["K_d"] * chase
        else:
            volts = v_0 + GAIN["K_p"] * miss + GAIN["K_i"] * (area + period * miss) + GAIN["K_d"] * chase
            if abs(volts) <= limit or volts * miss < 0.0:
                area += period * miss
        out.append(min(max(volts, -limit), limit))
    return np.array(out)


@pytest.mark.parametrize("period", [1e-3, 5e-3])
@pytest.mark.parametrize("limit", [1e6, 3.0])
@pytest.mark.parametrize("hold", [0.0, 0.3])
def test_it_is_the_discrete_pid_tick_by_tick(period: float, limit: float, hold: float) -> None:
    """With jumps of the setpoint, into its limit and out of it, and into that of its integral where it has one."""
    rng = np.random.default_rng(3)
    setpoint, angle = np.repeat(rng.uniform(0.2, 1.2, 8), 10), 0.7 + 0.2 * np.sin(0.1 * np.arange(80))
    found = run(controller(period, limit=limit, hold=hold), setpoint, angle, np.zeros(80), v_0=0.5)
    wanted = written_out(setpoint - angle, period, limit, 0.5, hold)
    assert_allclose(found, wanted, rtol=1e-12)
    assert (np.abs(wanted) == limit).any() == (limit < 10.0)
    assert not hold or np.max(np.abs(wanted - written_out(setpoint - angle, period, limit, 0.5, 0.0))) > 0.1


@pytest.mark.parametrize("how", [{"b": 0.0}, {"b": 0.4, "c": 0.0}, {"S_e": 5.0}])
@pytest.mark.parametrize("ahead", [0.0, 0.6])
def test_a_plate_at_rest_gets_what_the_ecu_put_out_where_the_trace_began(how: dict[str, float], ahead: float) -> None:
    effect = controller(limit=12.0, K_p=20.0, **how)
    z = tuple(jnp.asarray(each) for each in Controller.z0)
    x, u = State(0.0, 0.7, 0.0), inputs(voltage=1.5, controlled=1.0, setpoint=0.7, ahead=ahead, time=0.0)
    for time in (0.0, 1e-3, 2e-3):
        z = effect.ticked(x, z, u._replace(time=time))
        assert float(z[-1]) == pytest.approx(1.5)


def test_it_sees_the_angle_as_late_as_its_delay_says() -> None:
    """A sine of 3 Hz, 4 ms late, at gains of P alone."""
    effect, t = controller(1e-3, 4e-3, K_i=0.0, K_d=0.0), 1e-3 * np.arange(1000)
    turn = 2.0 * np.pi * 3.0
    found = run(effect, np.zeros(1000), np.sin(turn * t), turn * np.cos(turn * t))
    late, now = (-6.0 * np.sin(turn * (t - by)) for by in (4e-3, 0.0))
    assert np.max(np.abs(found - late)[100:]) < 0.02
    assert np.max(np.abs(now - late)) > 0.4


def parts(effect: Controller, theta: float, z: tuple[float, ...], **more: Any) -> Any:
    u = inputs(**({"voltage": 0.0, "controlled": 1.0, "setpoint": 1.0, "time": 1.0} | more))
    return effect(State(0.0, theta, 0.0), z, u)


def test_between_ticks_it_holds_what_it_put_out() -> None:
    c = parts(controller(), 0.3, (2.0, 0.0, 0.1, 4.5), voltage=1.5)
    assert 1.5 + float(c.voltage) == 4.5
    assert_allclose([float(rate) for rate in c.dz], 0.0)


@pytest.mark.parametrize("controlled", [None, 0.0])
def test_it_is_silent_where_it_drives_nothing(controlled: float | None) -> None:
    c = parts(controller(), 0.3, (2.0, 1.0, 1.0, 1.0), controlled=controlled)
    assert_allclose([float(c.voltage), *(float(r) for r in c.dz)], 0.0)


class Shifted(AbstractEffect):
    """Not an ECU: a sensor that shows 0.1 rad more, and an effect that shows the voltage it is told."""

    name = "shifted"

    def __call__(self, x: State, z: Any, u: Any) -> Any:
        return Contribution(position=0.1, torque=u.voltage)


def test_it_reads_the_sensor_and_all_others_feel_its_voltage() -> None:
    values = {p.symbol: getattr(controller(), p.symbol) for p in parameters_of(Controller)}
    throttle = Throttle.build((Shifted, Controller), values)
    u = inputs(voltage=0.0, controlled=1.0, setpoint=1.0, time=0.0)
    x = State(0.0, 0.8, 0.0)
    sensed, own = throttle.parts(x, throttle.ticked(x, throttle.z0, u), u)
    assert float(own.voltage) == pytest.approx((6.0 + 40.0 * 1e-3) * 0.1)
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
    assert set(NOMINAL_GAINS) == set(GAINS.values())
