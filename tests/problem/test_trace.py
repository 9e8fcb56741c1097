"""A measurement made ready: what drives it, what is observed, from where and when it starts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.problem.trace import moving_mean, prepare
from etcfit.rig.base import Channel, Measurement
from independent.drives import line
from measurements import CONFIG, OPEN, SIGMA, N, channel, driven, measurement, noisy, prepared, released

T = np.arange(500) * 1e-3


# ---- release


@pytest.mark.parametrize("channels", [("emf", "position"), ("emf",), ("position",)], ids=" and ".join)
@pytest.mark.parametrize("at", [0.0203, 0.0657])
def test_the_release_is_found_within_a_millisecond(at: float, channels: tuple[str, ...]) -> None:
    """As good a start as the fit needs, which goes on from there; the stated deviation covers what is left."""
    motion = released(at)
    values = {"emf": N * 0.0189 * motion.speed, "position": motion.angle}
    clean = measurement("back_emf", motion.time, {name: values[name] for name in channels})
    found = [prepared(noisy(clean, seed)).release for seed in range(20)]
    assert all(release is not None for release in found)
    instants, deviations = np.array(found).T
    assert np.max(np.abs(instants - at)) < 1e-3
    assert np.all(np.abs(instants - at) < deviations)


@pytest.mark.parametrize("channel", ["emf", "position"])
def test_a_plate_that_moves_from_the_first_sample_has_no_release(channel: str) -> None:
    motion = released(0.0)
    later = motion.time > 0.03
    values = {"emf": N * 0.0189 * motion.speed[later], "position": motion.angle[later]}
    clean = measurement("back_emf", motion.time[later], {channel: values[channel]})
    assert all(prepared(noisy(clean, seed)).release is None for seed in range(20))


@pytest.mark.parametrize("channels", [("emf", "position"), ("emf",)], ids=" and ".join)
def test_an_emf_that_does_not_read_zero_at_rest_is_no_motion(channels: tuple[str, ...]) -> None:
    """Six times its noise; the plate is let go at the same instant as without it."""
    motion = released(0.0657)
    values = {"emf": N * 0.0189 * motion.speed, "position": motion.angle}
    found = []
    for zero in (0.0, 6.0 * SIGMA["emf"]):
        shown = values | {"emf": values["emf"] + zero}
        found.append(prepared(noisy(measurement("back_emf", motion.time, {n: shown[n] for n in channels}), 0)).release)
    assert found[0] is not None
    assert found[1] == pytest.approx(found[0], abs=1e-9)


def test_only_a_held_plate_is_released() -> None:
    motion = released(0.05)
    m = measurement("response", motion.time, {"voltage": 0.0 * T[: motion.time.size], "position": motion.angle})
    assert prepared(m).release is None


def test_a_released_plate_starts_from_rest() -> None:
    motion = released(0.05)
    start = prepared(noisy(measurement("inertia", motion.time, {"position": motion.angle}), 0)).start
    assert start.state == (0.0, OPEN, 0.0)
    assert start.sd == (0.0, 0.0, 0.0)


# ---- start


@pytest.mark.parametrize(("stop", "offset"), [(0.0, 0.0), (OPEN, 0.0), (0.0, 4e-4), (OPEN, -4e-4)])
def test_a_plate_that_starts_on_a_stop_starts_exactly_there(stop: float, offset: float) -> None:
    m = measurement("response", T, {"voltage": 0 * T, "position": 0 * T + stop + offset})
    start = prepared(m).start
    assert start.state[1] == stop
    assert start.sd[1] == 0.0


def test_a_plate_at_rest_in_between_is_known_as_well_as_it_was_seen() -> None:
    wrong = []
    for seed in range(30):
        m = noisy(measurement("response", T, {"voltage": 0 * T, "position": 0 * T + 0.4}), seed)
        start = prepared(m).start
        assert start.state[2] == 0.0
        assert start.sd[1] >= SIGMA["position"]
        wrong.append(start.state[1] - 0.4)
    assert np.max(np.abs(wrong)) < 3.0 * SIGMA["position"]


def test_a_plate_that_starts_in_motion_has_a_speed_and_a_deviation_that_covers_it() -> None:
    """10 samples at 3 rad/s."""
    wrong = []
    for seed in range(30):
        m = noisy(measurement("response", T[:100], {"voltage": 0 * T[:100], "position": 0.3 + 3.0 * T[:100]}), seed)
        start = prepared(m).start
        wrong.append((np.array(start.state) - [0.0, 0.3, 3.0])[1:] / start.sd[1:])
    assert np.max(np.abs(wrong)) < 4.0
    assert 0.5 < np.std(np.array(wrong)[:, 1]) < 1.5  # honest, not just wide


def test_a_plate_on_its_stop_that_is_driven_from_the_first_sample_starts_at_rest() -> None:
    """9 V open it within ten samples: they bend, and the slope of what bends is no speed."""
    motion, exact = driven(line([0.0, 0.4], [9.0, 9.0]), 0.0), 0
    assert motion.angle[9] > 20.0 * SIGMA["position"]
    for seed in range(20):
        clean = measurement("response", motion.time, {"voltage": 0 * motion.time + 9.0, "position": motion.angle})
        start = prepared(noisy(clean, seed)).start
        if start.sd[1] == 0.0:  # seen to be on its stop
            assert start.state[1:] == (0.0, 0.0)
            assert start.sd[2] == 0.0
            exact += 1
    assert exact > 10


@pytest.mark.parametrize("hertz", [10.0, 25.0, 40.0])
def test_a_plate_that_starts_within_a_swing_has_the_speed_of_its_first_sample(hertz: float) -> None:
    """A plate in a limit cycle: the first ten samples turn, so a line through them is another speed."""
    time, turn, wrong = T[:100], 2.0 * np.pi * hertz, []
    for seed in range(48):
        phase = 2.0 * np.pi * seed / 48.0
        swing = 0.4 + 0.05 * np.sin(turn * time + phase)
        start = prepared(noisy(measurement("response", time, {"voltage": 0 * time, "position": swing}), seed)).start
        speed = 0.05 * turn * np.cos(phase)
        if start.sd[2] == 0.0:  # taken for rest: at a turning point, which ten samples in this noise cannot tell apart
            assert abs(speed) < 1.5
        else:
            wrong.append((np.array(start.state) - [0.0, swing[0], speed])[1:] / start.sd[1:])
    assert len(wrong) > 40
    # a bend that hides in the noise turns a slope taken for a straight one by more than its error: in one of 20
    assert np.quantile(np.abs(np.array(wrong)[:, 1]), 0.95) < 4.0
    assert 0.4 < np.sqrt(np.mean(np.square(wrong))) < 1.8


def test_a_current_that_flows_at_the_start_is_taken_from_the_log() -> None:
    m = noisy(measurement("response", T, {"voltage": 0 * T + 3, "current": 0 * T + 2.0, "position": 0 * T}), 1)
    start = prepared(m).start
    assert abs(start.state[0] - 2.0) < 3.0 * start.sd[0]


def test_where_an_edge_comes_with_the_first_sample_the_current_starts_from_that_sample() -> None:
    rise = 2.0 * (1.0 - np.exp(-T / 1e-3))
    m = noisy(measurement("response", T, {"voltage": 0 * T + 3, "current": rise, "position": 0 * T}), 1)
    start = prepared(m).start
    assert abs(start.state[0]) < 3.0 * start.sd[0]
    assert start.sd[0] < 0.1


def test_a_held_plate_stays_where_it_is() -> None:
    """The position of a held plate may be noise alone: no speed is read into it."""
    motion = driven(line([0.0, 0.3], [2.0, 2.0]), 0.5, held=True)
    m = noisy(measurement("resistance", motion.time, {"voltage": motion.voltage, "current": motion.current}), 0)
    trace = prepared(m)
    assert trace.start.state[2] == 0.0
    assert trace.start.sd[2] == 0.0
    assert trace.channels == ("current",)


def test_a_motor_alone_starts_at_its_speed() -> None:
    m = measurement("viscous", T, {"voltage": 0 * T, "current": 0 * T, "motor_speed": 0 * T + 40.0})
    start = prepared(m).start
    assert_allclose(start.state[2], 40.0 / N)
    assert_allclose(start.sd[2], SIGMA["motor_speed"] / N)


# ---- channels


def test_open_terminals_show_the_emf() -> None:
    motion = released(0.05)
    m = measurement("back_emf", motion.time, {"voltage": N * 0.0189 * motion.speed, "position": motion.angle})
    trace = prepared(m)
    assert trace.channels[0] == "emf"
    assert trace.input is None
    assert not trace.circuit
    assert_array_equal(trace.data[:, 0], m.channels["voltage"].value)


def test_a_torque_drives_a_plate_without_a_circuit() -> None:
    position = channel(T, 0 * T + 0.3, 1e-3)
    torque = Channel(T, 0 * T + 0.4, 1e-3, False, "torque", "N*m", 1.0)
    current = channel(T, 0 * T + 1.0, 1e-2)
    m = Measurement("drive/a.csv", "drive", T, {"torque": torque, "position": position, "current": current})
    trace = prepared(m)
    assert trace.torque_driven
    assert not trace.circuit
    assert trace.channels == ("position",)
    assert trace.start.state[0] == 0.0


def test_gaps_stay_gaps() -> None:
    some = np.delete(np.arange(T.size), np.arange(100, 140))
    m = Measurement(
        "response/a.csv",
        "response",
        T,
        {"voltage": channel(T, 0 * T, 1e-2), "position": channel(T[some], 0.1 + T[some], 1e-3)},
    )
    data = prepared(m).data[:, 0]
    assert_array_equal(np.flatnonzero(np.isnan(data)), np.arange(100, 140))
    assert_array_equal(data[some], 0.1 + T[some])


def test_noise_is_never_finer_than_the_logger() -> None:
    coarse = Channel(T, 0 * T, 1e-6, False, "position", "rad", 1.0, quantum=1e-3)
    m = Measurement("response/a.csv", "response", T, {"voltage": channel(T, 0 * T, 1e-2), "position": coarse})
    assert_allclose(prepared(m).sigma, 1e-3 / np.sqrt(12.0))


@pytest.mark.parametrize("channels", [("position",), ("voltage",)], ids=["no input", "nothing observed"])
def test_what_the_model_cannot_predict_is_left_out(channels: tuple[str, ...]) -> None:
    assert prepare(measurement("response", T, {name: 0 * T for name in channels}), CONFIG) is None


@pytest.mark.parametrize("width", [1, 2, 7, 50])
def test_the_smoothed_rise_is_a_moving_mean(width: int) -> None:
    value = np.abs(np.random.default_rng(0).standard_normal(500))
    expected = np.convolve(value, np.ones(width) / width, mode="same")
    assert_allclose(moving_mean(value, width), expected, atol=1e-12)
