"""Traces in a batch: every sample once and at its place, lanes that never overlap, instants that substeps preserve."""

from __future__ import annotations

import weakref
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.model.rig_effects import number_of, rig_effect
from etcfit.problem.batch import KINDS, TraceBatch, batch_of, pack, rounded
from etcfit.problem.prediction_error import columns
from etcfit.problem.trace import Trace
from etcfit.rig.base import Measurement, RigConfig
from measurements import CONFIG, N, channel, measurement, prepared, released


def trace(test: str, n: int, channels: tuple[str, ...], seed: int = 0) -> Trace:
    """A trace of noise on uneven instants."""
    rng = np.random.default_rng(seed)
    time = 0.2 + np.cumsum(rng.uniform(0.5e-3, 1.5e-3, n))
    return prepared(measurement(test, time, {c: 0.5 + 0.1 * rng.standard_normal(n) for c in channels}))


def mixed() -> list[Trace]:
    motion = released(0.0503)
    release = prepared(measurement("back_emf", motion.time, {"emf": N * 0.0189 * motion.speed}))
    assert release.release is not None
    return [
        trace("response", 40, ("voltage", "current", "position"), 1),
        trace("resistance", 11, ("voltage", "current"), 2),
        release,
        trace("viscous", 25, ("voltage", "current", "motor_speed"), 3),
        trace("response", 400, ("voltage", "position"), 4),
        trace("inductance", 30, ("voltage", "current"), 5),
    ]


def laid(traces: list[Trace], config: RigConfig = CONFIG, most: int = 4) -> tuple[TraceBatch, list[np.ndarray]]:
    rng = np.random.default_rng(7)
    substeps = [rng.integers(1, most + 1, t.instants.size - 1) for t in traces]
    return batch_of(traces, config, substeps), substeps


@pytest.fixture(scope="module")
def batch() -> TraceBatch:
    return laid(mixed())[0]


def rows(batch: TraceBatch) -> list[tuple[int, int, int]]:
    """Lane, first and last entry of each trace."""
    return [(lane, first, int(marks[-1])) for lane, first, marks in batch.places]


# ---- packing


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(1, 5000), min_size=1, max_size=40))
def test_packing_places_each_trace_once_and_none_too_far(lengths: list[int]) -> None:
    lanes, length = pack(lengths)
    assert sorted(k for lane in lanes for k in lane) == list(range(len(lengths)))
    assert all(sum(lengths[k] for k in lane) <= length for lane in lanes)
    assert length < 1.25 * max(lengths) + 8
    assert pack(lengths, 2 * length).length == 2 * length


def test_few_shapes_serve_many_folders() -> None:
    sizes = [rounded(n) for n in range(1, 5001)]
    assert all(n <= size < 1.125 * n + 1 for n, size in zip(range(1, 5001), sizes, strict=True))
    assert len(set(sizes)) < 90


def test_lanes_never_overlap(batch: TraceBatch) -> None:
    by_lane = sorted(rows(batch))
    for (lane, _, last), (other, first, _) in pairwise(by_lane):
        assert lane != other or last < first


def test_each_trace_begins_once_where_it_is_placed(batch: TraceBatch) -> None:
    begins = sorted((int(lane), int(row)) for row, lane in np.argwhere(batch.resets.begins > 0.5))
    assert begins == sorted((lane, first) for lane, first, _ in rows(batch))


def test_short_traces_share_a_lane() -> None:
    batch, _ = laid([trace("resistance", 50, ("voltage", "current"), k) for k in range(8)] + mixed()[4:5], most=1)
    used = {lane for lane, _, _ in batch.places}
    assert len(used) == 2


# ---- samples


def test_every_sample_appears_once_and_at_its_place(batch: TraceBatch) -> None:
    seen = np.zeros_like(batch.slots.weight)
    for t, (lane, _, marks) in zip(batch.traces, batch.places, strict=True):
        for m, name in enumerate(t.channels):
            assert_array_equal(batch.slots.value[marks, lane, m], t.data[:, m])
            assert_array_equal(batch.slots.sigma[marks, lane, m], t.sigma[m])
            assert np.all(batch.slots.kind[marks, lane, m] == KINDS.index(name))
            seen[marks, lane, m] += 1.0
    assert_array_equal(batch.slots.weight, seen)


def test_a_gap_has_no_weight() -> None:
    time = np.arange(20) * 1e-3
    kept = np.delete(np.arange(20), [3, 4])
    m = Measurement(
        "response/a.csv",
        "response",
        time,
        {"voltage": channel(time, 0 * time, 1e-2), "position": channel(time[kept], 0.1 + 0 * time[kept], 1e-3)},
    )
    gappy = prepared(m)
    batch, _ = laid([gappy])
    lane, _, marks = batch.places[0]
    assert_array_equal(np.flatnonzero(batch.slots.weight[marks, lane, 0] == 0.0), [3, 4])
    assert batch.slots.weight.sum() == 18.0


def test_columns_take_back_what_the_batch_put_there(batch: TraceBatch) -> None:
    for t, part in zip(batch.traces, columns(batch, batch.slots.value), strict=True):
        assert_array_equal(part, t.data)


# ---- steps


def test_substeps_preserve_the_instants(batch: TraceBatch) -> None:
    for t, (lane, first, marks) in zip(batch.traces, batch.places, strict=True):
        clock = np.cumsum(batch.steps.dt[first : marks[-1] + 1, lane])
        assert_allclose(clock[marks - first], t.instants - t.instants[0], atol=1e-12)
        assert_allclose(batch.steps.time[marks, lane], t.instants - t.instants[0], atol=1e-12)
        assert batch.steps.dt[first, lane] == 0.0
        assert np.all(batch.steps.dt[first + 1 : marks[-1] + 1, lane] >= 0.0)


def test_each_interval_has_the_substeps_asked_for_and_a_release_one_more() -> None:
    traces = mixed()
    batch, substeps = laid(traces)
    for t, n, (_, _, marks) in zip(traces, substeps, batch.places, strict=True):
        assert np.sum(np.diff(marks) - n) == (t.release is not None)


def test_the_input_is_linear_between_instants(batch: TraceBatch) -> None:
    t = batch.traces[0]
    assert t.input is not None
    lane, first, marks = batch.places[0]
    assert_allclose(batch.steps.voltage1[marks, lane], t.input.value, atol=1e-12)
    inside = slice(first + 1, marks[-1] + 1)
    assert_array_equal(batch.steps.voltage0[inside, lane], batch.steps.voltage1[first : marks[-1], lane])
    bend = np.interp(np.arange(first, marks[-1] + 1), marks, batch.steps.voltage1[marks, lane])
    assert_allclose(batch.steps.voltage1[first : marks[-1] + 1, lane], bend, atol=1e-12)


def test_a_duty_is_held() -> None:
    time = np.arange(10) * 1e-3
    duty = np.linspace(0.1, 1.0, 10)
    m = Measurement(
        "response/a.csv",
        "response",
        time,
        {"duty": channel(time, duty, 1e-3), "position": channel(time, 0 * time, 1e-3)},
    )
    t = prepared(m)
    batch, _ = laid([t], most=1)
    lane, _, marks = batch.places[0]
    assert_allclose(batch.steps.voltage0[marks[1:], lane], 12.0 * duty[:-1])
    assert_allclose(batch.steps.voltage1[marks[1:], lane], 12.0 * duty[:-1])


def test_a_plate_is_held_until_its_release_to_the_split_step(batch: TraceBatch) -> None:
    t, (lane, first, marks) = batch.traces[2], batch.places[2]
    assert t.release is not None
    mobile = batch.steps.mobile[first : marks[-1] + 1, lane]
    clock = t.instants[0] + batch.steps.time[first : marks[-1] + 1, lane]
    assert_array_equal(mobile, clock > t.release[0])
    assert_allclose(clock[mobile < 0.5].max(), t.release[0], atol=1e-12)
    variance = batch.disturbance.release[first : marks[-1] + 1, lane]
    assert_array_equal(np.flatnonzero(variance), np.flatnonzero(mobile)[:1])
    assert_allclose(variance.max(), t.release[1] ** 2)


def test_boundaries_are_those_of_the_rig_test(batch: TraceBatch) -> None:
    wanted = {"response": (1, 1, 1), "resistance": (0, 1, 1), "viscous": (1, 1, 0), "inductance": (0, 1, 1)}
    for t, (lane, _, marks) in zip(batch.traces, batch.places, strict=True):
        for name, value in zip(("mobile", "circuit", "plate"), wanted.get(t.test.name, ()), strict=False):
            assert np.all(getattr(batch.steps, name)[marks, lane] == value)
        if t.test.name == "back_emf":
            assert np.all(batch.steps.circuit[marks, lane] == 0.0)


def test_a_torque_enters_at_the_plate() -> None:
    time = np.arange(10) * 1e-3
    torque = channel(time, np.linspace(0.1, 1.0, 10), 1e-6)
    m = Measurement("drive/a.csv", "drive", time, {"torque": torque, "position": channel(time, 0 * time, 1e-3)})
    t = prepared(m)
    batch, _ = laid([t], most=1)
    lane, _, marks = batch.places[0]
    assert_allclose(batch.steps.torque1[marks, lane], torque.value, atol=1e-5)
    assert np.all(batch.steps.voltage1 == 0.0)
    assert np.all(batch.steps.circuit == 0.0)


def test_each_entry_knows_its_rig_test_and_its_file(batch: TraceBatch) -> None:
    assert len({t.test.name for t in batch.traces}) > 2
    for t, (lane, _, marks) in zip(batch.traces, batch.places, strict=True):
        assert np.all(batch.test_of[marks, lane] == number_of(t.test.name))
        assert np.all(np.asarray(batch.steps.trace)[marks, lane] == number_of(t.measurement.file))


def test_a_supply_that_nobody_logged_sags_by_the_square_of_the_duty(batch: TraceBatch) -> None:
    """R_s = 0.4 ohm: a duty of -0.5 is a resistance of 0.1 ohm; where the supply was logged, it has sagged already."""
    time, sag = np.arange(10) * 1e-3, rig_effect("supply_sag")
    assert sag is not None
    assert batch.steps.duty is None  # driven by a voltage
    drive = {"duty": channel(time, np.full(10, -0.5), 1e-3), "position": channel(time, 0 * time, 1e-3)}
    supply = {"supply": channel(time, np.full(10, 12.0), 1e-3)}
    for channels, ohm in ((drive, 0.1), (drive | supply, 0.0)):
        t = prepared(Measurement("drive/a.csv", "drive", time, channels))
        driven, _ = laid([t], most=1)
        lane, _, marks = driven.places[0]
        series = np.broadcast_to(sag(**{"supply_ohm": 0.4}).driven(driven.steps, 0.0).series, driven.steps.dt.shape)
        assert_allclose(series[marks[1:], lane], ohm)


# ---- what is uncertain


def test_the_input_error_has_the_stated_variance_and_memory_at_each_instant(batch: TraceBatch) -> None:
    """e_k = keep e_(k-1) + w: where an error's size does not change, its variance stays that of the input."""
    t, (lane, first, marks) = batch.traces[1], batch.places[1]
    assert t.input is not None
    keep, fresh = batch.disturbance.keep[first:, lane], batch.disturbance.fresh[first:, lane]
    variance, out = 0.0, []
    for k in range(int(marks[-1] - first) + 1):
        variance = keep[k] ** 2 * variance + fresh[k]
        out.append(variance)
    assert_allclose(out[1], t.input.error[0] ** 2)
    ratio = np.array(out)[marks[1:] - first] / t.input.error[:-1] ** 2
    assert np.all((ratio > 0.5) & (ratio < 2.0))


def test_the_start_is_uncertain_at_the_first_entry_only(batch: TraceBatch) -> None:
    for t, (lane, first, marks) in zip(batch.traces, batch.places, strict=True):
        for name, sd in zip(("i", "theta", "omega"), t.start.sd, strict=True):
            column = getattr(batch.disturbance, f"start_{name}")[first : marks[-1] + 1, lane]
            assert_allclose(column[0], sd**2)
            assert np.all(column[1:] == 0.0)


def resident(array: np.ndarray) -> int:
    """Bytes that an array holds, be it a view."""
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array.nbytes


def test_a_column_that_is_the_same_everywhere_takes_no_memory(batch: TraceBatch) -> None:
    for column in (batch.steps.gear_ratio, batch.steps.upper, batch.steps.series):
        assert column.shape == np.shape(batch.steps.dt)
        assert np.ptp(column) == 0.0
        assert resident(column) < 100
    assert batch.steps.gear_ratio[0, 0] == CONFIG.gear_ratio
    assert resident(batch.steps.dt) == batch.steps.dt.size * 8


def test_a_guide_of_one_stiffness_is_one_array_as_long_as_somebody_has_it(batch: TraceBatch) -> None:
    first, second, other = batch.guided(2.0), batch.guided(2.0), batch.guided(3.0)
    assert first.guide_stiffness is second.guide_stiffness
    assert_array_equal(other.guide_stiffness, 1.5 * first.guide_stiffness)
    gone = weakref.ref(first.guide_stiffness)
    del first, second
    assert gone() is None


@pytest.mark.parametrize("later", [1e-4, 7e-3])
def test_a_plate_let_go_at_another_instant_lies_as_in_a_new_batch_and_the_rest_is_not_copied(later: float) -> None:
    batch, substeps = laid(mixed())
    traces = tuple(t.released_at(t.release[0] + later, t.release[1]) if t.release else t for t in batch.traces)
    found, wanted = batch.with_times_of(traces, CONFIG, substeps), batch_of(traces, CONFIG, substeps)
    assert found.traces == traces
    for (lane, row, marks), (lane_anew, row_anew, marks_anew) in zip(found.places, wanted.places, strict=True):
        assert (lane, row) == (lane_anew, row_anew)
        assert_array_equal(marks, marks_anew)
    for part in ("steps", "resets", "slots", "disturbance"):
        for one, other in zip(getattr(found, part), getattr(wanted, part), strict=True):
            assert (one is None) == (other is None)
            if one is not None:
                assert_array_equal(one, other)
    assert found.steps.voltage0 is batch.steps.voltage0
    assert found.slots.kind is batch.slots.kind
    assert not np.array_equal(found.steps.dt, batch.steps.dt)
