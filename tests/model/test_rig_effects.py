"""The contract of rig effects: off they change nothing, on they do what they say, in their place alone."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.model.parameters import declared, parameters_of
from etcfit.model.rig_effects import (
    OBSERVED,
    RIG_EFFECTS,
    AbstractRigEffect,
    ChannelGain,
    EdgePhase,
    OtherRig,
    Place,
    SupplySag,
    TraceLate,
    at_places,
    number_of,
    rig_effect,
)
from etcfit.model.rig_effects.base import APART
from etcfit.model.stepper import Edge, Reset, Step
from etcfit.rig import TESTS
from etcfit.rig.config import parse_config

LOGGED = {
    "resistance": frozenset({"voltage", "current"}),
    "back_emf": frozenset({"emf", "position"}),
    "viscous": frozenset({"voltage", "current", "motor_speed"}),
    "response": frozenset({"voltage", "current", "position"}),
    "inertia": frozenset({"emf", "position", "motor_speed"}),
    "sine": frozenset({"torque", "position"}),
    "closed_loop": frozenset({"voltage", "duty", "position", "current"}),
}
FILES = {"response/1.csv": LOGGED["response"], "response/2.csv": LOGGED["response"],
         "resistance/1.csv": LOGGED["resistance"], "inertia/1.csv": LOGGED["inertia"],
         "inertia/2.csv": LOGGED["inertia"]}  # fmt: skip
EVERY = (*at_places(LOGGED, FILES), EdgePhase.at(Place("response")))
KINDS = sorted({effect.kind for effect in EVERY})
every_kind = pytest.mark.parametrize("effects", [[e for e in EVERY if e.kind == kind] for kind in KINDS], ids=KINDS)
PARTS = ("command", "edge")  # of a step that a batch may do without
SEEN = {"current": jnp.array([1.0, 2.0]), "position": jnp.array([0.3, 0.4]), "emf": jnp.array([0.5, 0.6]),
        "motor_speed": jnp.array([7.0, 8.0])}  # fmt: skip


def made(effect: type[AbstractRigEffect], value: float) -> Any:
    """The effect, all its parameters off by `value` times their usual size."""
    off = effect.off or {}
    return effect(**{field: off[p.symbol] + value * p.domain.scale for field, p in declared(effect).items()})


def steps(file: str = "") -> Step:
    rng = np.random.default_rng(0)
    values: dict[str, Any] = {name: jnp.asarray(rng.uniform(0.5, 1.5, 2)) for name in Step._fields if name not in PARTS}
    values["trace"] = jnp.full(2, number_of(file))
    return Step(**values, edge=Edge(jnp.zeros(2), jnp.array([0.2, -0.2]), jnp.array([0.1, 0.3])))


def begun() -> Reset:
    return Reset(jnp.array([1.0, 0.0]), jnp.array([0.1, 0.0]), jnp.array([0.2, 0.0]), jnp.array([0.3, 0.0]))


def all_of(effect: Any, test_of: Any, file: str = "") -> list[Any]:
    """Everything that the effect makes of what is given; lateness beside what is not late."""
    given = steps(file)
    shown = effect.read(dict(SEEN), test_of, given.trace)
    late = {channel: jnp.zeros(2) for channel in OBSERVED} | effect.lateness(given, test_of)
    driven, starts = effect.driven(given, test_of), effect.begun(begun(), test_of, given.trace)
    return [*jax.tree.leaves((driven, starts)), *shown.values(), *(late[channel] for channel in OBSERVED)]


def as_given(file: str = "") -> list[Any]:
    """What `all_of` gives of an effect that changes nothing."""
    return [*jax.tree.leaves((steps(file), begun())), *SEEN.values(), *[jnp.zeros(2)] * len(OBSERVED)]


def changes(effect: type[AbstractRigEffect]) -> bool:
    """Whether it changes anything in its own place."""
    here = all_of(made(effect, 1.0), jnp.full(2, number_of(effect.place.test)), effect.place.file)
    given = as_given(effect.place.file)
    return any(np.any(np.asarray(a) != np.asarray(b)) for a, b in zip(here, given, strict=True))


@every_kind
def test_off_it_changes_nothing(effects: list[type[AbstractRigEffect]]) -> None:
    for effect in effects:
        here, file = jnp.full(2, number_of(effect.place.test)), effect.place.file
        for now, given in zip(all_of(made(effect, 0.0), here, file), as_given(file), strict=True):
            assert_array_equal(now, given, err_msg=effect.name)


@every_kind
def test_on_it_changes_something_in_its_place_and_nothing_elsewhere(effects: list[type[AbstractRigEffect]]) -> None:
    assert [effect.name for effect in effects if not changes(effect)] == []
    for effect in effects:
        place = effect.place
        elsewhere = [("elsewhere", "")] if place.test else []
        elsewhere += [(place.test, f"{place.test}/elsewhere.csv")] if place.file else []
        for test, file in elsewhere:
            there = all_of(made(effect, 1.0), jnp.full(2, number_of(test)), file)
            for now, was in zip(there, as_given(file), strict=True):
                assert_array_equal(now, was, err_msg=effect.name)


@every_kind
def test_its_name_says_where_it_is_and_what_a_diagnosis_proposes_is_read_from_rig_toml(
    effects: list[type[AbstractRigEffect]],
) -> None:
    for effect in effects:
        assert rig_effect(effect.name) is effect
        assert effect.name.startswith(effect.kind)
        assert str(effect.place) in effect.name
        assert effect.off is not None
        assert set(effect.off) <= {p.symbol for p in parameters_of(effect)}
        assert all(p.symbol.endswith(str(effect.place)) for p in parameters_of(effect))
        assert effect.place in effect.everywhere(LOGGED, FILES)
        proposed = effect.mend(0.1)
        assert proposed
        _, named, line = proposed.partition("[model]")
        if named:
            config = parse_config(f"[rig]\n[model]\n{line.split(', or ')[0].strip()}", "rig.toml")
            assert [rig_effect(name) for name in config.effects] == [effect]


def test_so_is_what_it_proposes_of_a_file_with_quotes_in_its_name() -> None:
    effect = TraceLate.at(Place.named('response/a "b" \\\\ c.csv'))
    config = parse_config(f"[rig]\n[model]\n{effect.mend(0.1).partition(']')[2].strip()}", "rig.toml")
    assert config.effects == (effect.name,)


def test_an_effect_may_be_named_where_it_changes_something_and_nowhere_else() -> None:
    for family in set(RIG_EFFECTS) - {OtherRig}:  # which is asked of every file, see estimation.rig_places
        given = [family.at(place) for place in family.everywhere(LOGGED, FILES)]
        assert given
        assert [effect for effect in given if not changes(effect)] == []
    assert SupplySag.everywhere({"response": frozenset({"voltage", "current"})}, {}) == ()
    assert ChannelGain.everywhere({"response": frozenset({"voltage", "duty"})}, {}) == (Place("response", "voltage"),)


def test_a_scale_of_the_angle_is_asked_about_only_where_more_than_a_torque_drives() -> None:
    for driving, told in (("torque", False), ("voltage", True), ("emf", True)):
        found = at_places({"response": frozenset({driving, "position"})})
        assert ("sensor_end_points" in {e.kind for e in found}) is told


def test_a_supply_sags_only_where_a_current_says_how_much_it_gave() -> None:
    driven = {"response": frozenset({"voltage", "duty", "position"})}
    assert "supply_sag" not in {e.kind for e in at_places(driven)}
    logged = {"response": driven["response"] | {"current"}}
    assert "supply_sag" in {e.kind for e in at_places(logged)}


def test_every_family_has_a_place_in_a_rig_that_logs_everything() -> None:
    found_otherwise = {EdgePhase.kind, OtherRig.kind}
    assert {e.kind for e in at_places(LOGGED, FILES)} == {family.kind for family in RIG_EFFECTS} - found_otherwise
    assert len({e.name for e in EVERY}) == len(EVERY)
    symbols = [p.symbol for e in EVERY for p in parameters_of(e)]
    assert len(set(symbols)) == len(symbols)


def test_a_channel_of_one_trace_is_written_after_its_file_and_read_back() -> None:
    place = Place("response", "current", "response/a.b/3.csv")
    assert str(place) == "response/a.b/3.csv.current"
    assert Place.named(str(place)) == place
    assert Place.named("response/a.b/3.csv") == Place("response", "", "response/a.b/3.csv")
    assert place.words == "current of the trace response/a.b/3.csv"
    assert ChannelGain.at(place).scope == "trace"
    assert ChannelGain.at(Place("response", "current")).scope == "test"


def channels_of(kind: str, logged: dict[str, frozenset[str]]) -> set[str]:
    return {str(e.place) for e in at_places(LOGGED, logged) if e.kind == kind and e.place.file and e.place.channel}


def test_a_channel_of_a_trace_is_asked_about_where_another_trace_logged_it() -> None:
    found = channels_of("channel_gain", FILES)
    assert {"response/1.csv.current", "response/2.csv.position", "inertia/1.csv.emf"} <= found
    assert "inertia/1.csv.emf" not in channels_of("channel_gain", {"inertia/1.csv": FILES["inertia/1.csv"]})


def test_where_a_test_has_one_trace_the_test_is_asked_instead() -> None:
    places = {str(e.place) for e in at_places(LOGGED, FILES) if e.kind == "channel_gain"}
    assert "resistance.current" in places
    assert "resistance/1.csv.current" not in places


def test_a_single_measured_channel_that_is_late_is_a_trace_that_is() -> None:
    files = {f"viscous/{k}.csv": frozenset({"voltage", "current"}) for k in (1, 2)}
    assert channels_of("channel_late", files) == set()
    assert channels_of("channel_late", {f: seen | {"motor_speed"} for f, seen in files.items()}) == {
        f"{file}.{channel}" for file in files for channel in ("current", "motor_speed")
    }


def test_a_trace_of_one_signal_has_nothing_to_compare_it_with() -> None:
    assert channels_of("channel_offset", {f"viscous/{k}.csv": frozenset({"current"}) for k in (1, 2)}) == set()


def test_a_rig_of_one_test_has_nothing_to_compare() -> None:
    assert {e.kind for e in at_places({"response": LOGGED["response"]})} == {"sensor_end_points"}


def test_a_name_that_is_none() -> None:
    assert rig_effect("gravity_load") is None
    assert rig_effect("channel_gain[response.current") is None
    assert rig_effect("channel_gain[]") is None
    assert rig_effect("channel_gain[response.]") is None


def test_rig_tests_have_numbers_of_their_own() -> None:
    numbers = [number_of(test.name) for test in TESTS]
    assert len(set(numbers)) == len(numbers)
    assert 0.0 not in numbers  # that of entries that belong to no trace


def test_what_reads_too_much_was_less() -> None:
    effect = rig_effect("channel_gain[response.voltage]")
    assert effect is not None
    here = jnp.full(2, number_of("response"))
    driven = made(effect, 5.0).driven(steps(), here)  # 10 % too much
    assert_allclose(1.1 * driven.voltage1, steps().voltage1)
    current = rig_effect("channel_gain[response.current]")
    assert current is not None
    assert_allclose(made(current, 5.0).read(dict(SEEN), here, None)["current"], 1.1 * SEEN["current"])


def test_a_drift_is_none_where_a_trace_begins_and_grows_from_step_to_step_without_a_jump() -> None:
    effect = rig_effect("channel_drift[response.torque]")
    assert effect is not None
    given = steps()._replace(dt=jnp.array([0.5, 0.5]), time=jnp.array([0.5, 1.0]))
    driven = made(effect, 3.0).driven(given, jnp.full(2, number_of("response")))  # 0.03 N m/s
    assert_allclose(given.torque0 - driven.torque0, [0.0, 0.015], atol=1e-15)
    assert_allclose(given.torque1 - driven.torque1, [0.015, 0.03], atol=1e-15)


def test_a_position_reads_off_where_the_plate_is_and_begins_where_it_was() -> None:
    effect = rig_effect("sensor_end_points")
    assert effect is not None
    off = made(effect, 1.0)
    shown = off.read({"position": begun().theta}, 0.0, None)["position"]
    back = off.begun(begun()._replace(theta=shown * begun().begins), 0.0, None)
    assert_allclose(back.theta, begun().theta, atol=1e-15)


def test_a_motor_alone_begins_with_its_speed_over_the_right_ratio() -> None:
    effect = rig_effect("gear_ratio")
    assert effect is not None
    assert [test.name for test in TESTS if test.boundary.gear_apart] == [APART]
    (error,) = parameters_of(effect)
    twice = made(effect, 1.0 / error.domain.scale)
    assert_allclose(twice.begun(begun(), number_of(APART), None).omega, 0.5 * begun().omega)
    assert_array_equal(twice.begun(begun(), number_of("inertia"), None).omega, begun().omega)  # read off the plate


def test_a_ratio_cured_of_one_error_and_off_by_another_is_off_by_both() -> None:
    effect = rig_effect("gear_ratio")
    assert effect is not None
    given = parse_config("[rig]\ngear_ratio = 0.05\n", "rig.toml")
    cured = effect.cured(given, 399.0)
    assert cured is not None
    assert cured.gear_ratio == pytest.approx(20.0)
    assert (1.0 + effect.compounded(399.0, 0.034)) * given.gear_ratio == pytest.approx(1.034 * cured.gear_ratio)
    assert all(e.cured(given, 0.1) is None for e in EVERY if e.kind != "gear_ratio")


@pytest.mark.parametrize(("gain", "kind"), [(0.05, "channel_gain"), (-2.0, "channel_sign"), (999.0, "unit_scale"),
                                            (-0.999, "unit_scale"), (-1.9, "channel_sign")])  # fmt: skip
def test_what_a_gain_is_called(gain: float, kind: str) -> None:
    effect = RIG_EFFECTS[1].at(Place("response", "current"))
    assert effect.called(gain) == kind


@pytest.mark.parametrize(("phase", "shares"), [(0.3, (0.3, 1.0)), (-0.1, (0.0, 0.9)), (0.0, (0.0, 1.0))])
def test_an_edge_comes_its_phase_and_its_turn_after_the_sample_and_never_beyond_its_interval(
    phase: float, shares: tuple[float, float]
) -> None:
    placed: Any = EdgePhase.at(Place("response"))
    edge = Edge(jnp.array([0.0, 1.0]), jnp.array([0.2, -0.2]), jnp.array([0.1, 0.3]))
    driven = placed(edge_phase=phase).driven(steps()._replace(edge=edge), jnp.full(2, number_of("response")))
    assert_allclose(driven.dt - steps().dt, (np.array(shares) - 0.5) * edge.span, atol=1e-6)
    assert_allclose(driven.time - steps().time, (np.array(shares) - 0.5) * edge.moves, atol=1e-6)
