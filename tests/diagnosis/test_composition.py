"""The model of all effects: which of them are at work is a choice of free parameters, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from etcfit.diagnosis.composition import Composition, by_file, carried, compose, is_of_the_rig, logged, resting, room
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS, PAPER
from etcfit.model.parameters import parameters_of
from etcfit.model.rig_effects import AbstractRigEffect, Place, SeriesResistance, at_places
from etcfit.model.smooth import UNKNOWNS
from etcfit.problem.free_parameters import FreeParameters, free_parameters
from etcfit.problem.trace import Trace, by_test
from etcfit.rig.base import Finding, Fixed, Prior, Rig

LIMP, STRIBECK, GRAVITY, COASTING = (
    EFFECT_BY_NAME[n] for n in ("limp_home_spring", "stribeck_friction", "gravity_load", "coasting_bridge")
)
OF_RIG_TOML = (SeriesResistance.at(Place("inductance")),)  # its circuit is free there
BEYOND = [e for e in EFFECTS if e not in PAPER and "bridge" not in e.needs]  # no check found one
every_candidate = pytest.mark.parametrize("effect", BEYOND, ids=lambda effect: effect.name)


def knowing(rig: Rig, **config: object) -> Rig:
    return replace(rig, config=replace(rig.config, **config))  # pyright: ignore[reportArgumentType]


def read(u: FreeParameters, x: np.ndarray) -> dict[str, float]:
    return {s: float(v) for s, v in u.layout.values(x, u.held).items()}


def typical(u: FreeParameters) -> np.ndarray:
    """Coordinates that no nominal value has."""
    values = {p.symbol: 1.3 * (p.nominal or p.domain.scale) for p in u.layout.parameters}
    return u.layout.coordinates(values)


# ---- what the data could show


def test_a_rig_that_logs_everything_has_every_effect_as_a_candidate(composition: Composition) -> None:
    assert composition.known == (*PAPER, *OF_RIG_TOML)
    assert set(composition.candidates) == set(BEYOND)
    assert set(composition.whole.layout.types) == {*PAPER, *BEYOND, *OF_RIG_TOML}


def test_a_bridge_coasts_where_a_check_tells_of_it(rig: Rig, traces: tuple[Trace, ...]) -> None:
    """And the voltage of its full duty is the supply's."""
    speeds = Finding("coasting_bridge", 0.3, "", 0.0, "", "", "response")
    found = compose(replace(rig, findings=(speeds,)), traces, only=EFFECTS)
    assert COASTING in found.candidates
    assert found.stated == {COASTING: 0.1}
    on_trial = found.on_trial((COASTING,))
    assert {"K_c", "k_d"} <= set(on_trial.layout.free)
    assert dict(zip(on_trial.layout.held, on_trial.held, strict=True))["V_0"] == 12.0


def test_what_was_logged_is_read_off_the_traces(rig: Rig, traces: tuple[Trace, ...]) -> None:
    by_test = {t.test.name: t for t in traces}
    some = {name: logged(rig, (by_test[name],)) for name in ("response", "resistance", "back_emf")}
    assert some["response"] == {"circuit", "current", "position", "gear"}
    assert some["resistance"] == {"circuit", "current", "gear"}
    assert some["back_emf"] == {"position", "gear"}
    assert logged(knowing(rig, gear_ratio_given=False), (by_test["resistance"],)) == {"circuit", "current"}


@pytest.mark.parametrize("test", ["resistance", "back_emf"])
def test_an_effect_that_these_traces_cannot_show_is_no_candidate(
    rig: Rig, traces: tuple[Trace, ...], test: str
) -> None:
    only = tuple(t for t in traces if t.test.name == test)
    seen = logged(rig, only)
    candidates = compose(rig, only, only=EFFECTS).candidates
    assert set(candidates) == {e for e in BEYOND if set(e.needs) <= seen}
    assert 0 < len(candidates) < len(BEYOND)


def test_an_effect_that_rig_toml_names_is_at_work_from_the_start(rig: Rig, traces: tuple[Trace, ...]) -> None:
    named = compose(knowing(rig, effects=("gravity_load",)), traces)
    assert GRAVITY in named.known
    assert GRAVITY not in named.candidates
    assert "T_g" in named.with_asleep(named.inside, ()).layout.free


def test_further_effects_are_candidates_beside_the_catalogue(rig: Rig, traces: tuple[Trace, ...]) -> None:
    more = compose(rig, traces, UNKNOWNS, EFFECTS)
    assert set(more.candidates) == {*BEYOND, *UNKNOWNS}
    assert set(more.with_asleep(more.inside, (UNKNOWNS[0],)).layout.free) >= set(UNKNOWNS[0].symbols)


# ---- which effects are at work


def test_without_a_candidate_what_is_free_is_what_the_fit_had_free(composition: Composition, rig: Rig) -> None:
    bare, known = composition.with_asleep(composition.inside, ()), free_parameters(rig.config)
    assert bare.layout.free == known.layout.free
    assert bare.layout.ties == known.layout.ties
    held = dict(zip(bare.layout.held, bare.held.tolist(), strict=True))
    assert held["B_m"] == 2e-5
    x = typical(known)
    values = read(bare, x)
    assert {s: values[s] for s in read(known, x)} == read(known, x)


@every_candidate
def test_an_effect_that_is_not_at_work_is_held_at_its_off_values(composition: Composition, effect: type) -> None:
    u = composition.with_asleep(composition.inside, tuple(e for e in composition.candidates if e is not effect))
    values = read(u, typical(u))
    for p in parameters_of(effect):
        assert p.symbol not in u.layout.free
        assert values[p.symbol] == effect.off.get(p.symbol, p.nominal)
    others = {p.symbol for e in composition.candidates if e is not effect for p in parameters_of(e)}
    assert others <= set(u.layout.free)


@every_candidate
def test_an_effect_that_is_added_frees_its_own_parameters_and_no_other(composition: Composition, effect: type) -> None:
    bare, more = (
        composition.with_asleep(composition.inside, ()).layout,
        composition.with_asleep(composition.inside, (effect,)).layout,
    )
    assert set(more.free) - set(bare.free) == {p.symbol for p in parameters_of(effect)} == set(resting(effect))
    assert tuple(s for s in more.free if s in bare.free) == bare.free
    assert set(more.held) == set(bare.held) - set(resting(effect))


def test_every_choice_is_one_program(composition: Composition) -> None:
    """The form compiles; the room is that of a model with a few parameters more."""
    bare = composition.with_asleep(composition.inside, ()).layout
    for effect in composition.candidates:
        layout = composition.with_asleep(composition.inside, (effect,)).layout
        assert layout.form == bare.form
        assert hash(layout.form) == hash(bare.form)
        assert layout.room == bare.room >= len(layout.free)
    assert composition.with_asleep(composition.inside, composition.candidates).layout.form == bare.form


def test_shapes_rest_at_nominal_values_and_amplitudes_at_off_ones() -> None:
    assert resting(LIMP) == {"T_lh": 0.0, "K_lh": 0.0, "theta_lh": 0.15, "d_lh": 0.01}


def test_room_is_the_next_multiple_of_eight() -> None:
    assert [room(n) for n in (1, 7, 8, 9, 16, 17)] == [8, 8, 8, 16, 16, 24]


def test_a_rig_has_effects_of_its_own_where_tests_can_be_compared(rig: Rig, traces: tuple[Trace, ...]) -> None:
    both = compose(rig, traces)
    names = {e.name for e in both.of_the_rig}
    every = at_places(by_test(traces), by_file(traces))
    assert names == {e.name for e in every} - {e.name for e in OF_RIG_TOML}
    assert {"series_resistance[resistance]", "channel_gain[response.current]", "time_scale[inductance]"} <= names
    assert set(both.candidates) - set(both.of_the_rig) == set(BEYOND)
    alone = compose(rig, tuple(t for t in traces if t.test.name == "response"))
    assert {e.name for e in alone.of_the_rig} == {"sensor_end_points"}


def test_beside_a_trace_held_out_the_only_fitted_one_of_a_test_may_be_wrong_by_itself(
    rig: Rig, traces: tuple[Trace, ...]
) -> None:
    """Both would be the same to what is fitted; a trace that is held out tells them apart."""
    held_out = tuple(
        replace(t, measurement=replace(t.measurement, file="response/9.csv"))
        for t in traces
        if t.test.name == "response"
    )
    without, beside = (compose(rig, traces, held_out=each) for each in ((), held_out))
    more = {e.name for e in beside.of_the_rig} - {e.name for e in without.of_the_rig}
    assert {"channel_gain[response/1.csv.current]", "warm_start[response/1.csv]"} <= more
    assert not any("response/9.csv" in name for name in more)
    # so has a model with a smooth curve beside such an effect
    added = next(e for e in beside.of_the_rig if e.name == "channel_gain[response/1.csv.current]")
    assert added in compose(rig, traces, UNKNOWNS, (added,), held_out).candidates


def test_effects_of_the_rig_lie_in_a_lean_model_only_beside_one_of_them(rig: Rig, traces: tuple[Trace, ...]) -> None:
    both = compose(rig, traces)
    one, other = both.of_the_rig[:2]
    assert not any(is_of_the_rig(t) for t in both.lean((GRAVITY,)).layout.types if t not in OF_RIG_TOML)
    assert both.on_trial((one,)).layout.form == both.on_trial((other,)).layout.form
    assert both.on_trial((GRAVITY,)).layout.form == both.lean((GRAVITY,)).layout.form
    assert [t for t in both.lean((one,)).layout.types if is_of_the_rig(t)] == [*OF_RIG_TOML, one]
    free = both.with_the_rig(()).layout.free
    assert set(free) - set(both.lean(()).layout.free) == {s for e in both.prompt for s in resting(e)}


def test_what_is_late_lies_beside_what_is_late_and_of_single_traces_the_one_on_trial(
    rig: Rig, traces: tuple[Trace, ...]
) -> None:
    both = compose(rig, traces)
    late = [e for e in both.of_the_rig if e.delays and issubclass(e, AbstractRigEffect)]
    tests, files = ([e for e in late if bool(e.place.file) is single] for single in (False, True))
    assert {e.kind for e in tests} == {"channel_late"}
    assert {e.kind for e in files} == {"trace_late"}
    assert {e.place.file for e in files} == {"inductance/1.csv", "response/1.csv"}  # a resistance does not tell time
    assert set(late) | set(both.prompt) == set(both.of_the_rig)  # each test has one trace: none was warm alone
    assert both.on_trial(tuple(tests[:1])).layout.form == both.on_trial(tuple(tests[1:2])).layout.form
    assert [e for e in both.on_trial((files[0],)).layout.types if e in files] == [files[0]]
    assert not any(e.delays for e in both.on_trial((both.prompt[0],)).layout.types)


def test_priors_are_those_of_what_is_free(rig: Rig, traces: tuple[Trace, ...]) -> None:
    told = compose(knowing(rig, parameters={"K_s": Prior(0.15, 0.01), "T_g": Prior(0.0, 0.1)}), traces, only=EFFECTS)
    assert set(told.with_asleep(told.inside, ()).priors) == {"K_s"}
    assert set(told.with_asleep(told.inside, (GRAVITY,)).priors) == {"K_s", "T_g"}


def test_what_rig_toml_fixes_stays_fixed_in_an_effect_that_is_added(rig: Rig, traces: tuple[Trace, ...]) -> None:
    told = compose(knowing(rig, parameters={"theta_lh": Fixed(0.2)}), traces, only=EFFECTS)
    u = told.with_asleep(told.inside, (LIMP,))
    assert "theta_lh" not in u.layout.free
    assert read(u, typical(u))["theta_lh"] == 0.2
    assert "T_lh" in u.layout.free


# ---- from one choice to another


def test_coordinates_stay_as_they_are_when_an_effect_is_added_or_taken_away(composition: Composition) -> None:
    bare, more = (
        composition.with_asleep(composition.inside, ()),
        composition.with_asleep(composition.inside, (LIMP, GRAVITY)),
    )
    x = np.random.default_rng(0).normal(size=len(bare.layout.free))
    values = {"T_lh": 0.3, "K_lh": 0.7, "theta_lh": 0.2, "d_lh": 0.02, "T_g": -0.4}
    there = carried(x, bare.layout, more, values)
    assert_array_equal([there[more.layout.free.index(s)] for s in bare.layout.free], x)
    found = read(more, there)
    assert {s: found[s] for s in values} == pytest.approx(values, rel=1e-9)
    assert_array_equal(carried(there, more.layout, bare, {}), x)


def test_a_parameter_that_is_new_must_be_given_a_value(composition: Composition) -> None:
    bare, more = (
        composition.with_asleep(composition.inside, ()),
        composition.with_asleep(composition.inside, (GRAVITY,)),
    )
    with pytest.raises(KeyError, match="T_g"):
        carried(np.zeros(len(bare.layout.free)), bare.layout, more, {})


# ---- the same model without what is not at work


@pytest.mark.parametrize("added", [(), (GRAVITY,), (STRIBECK, LIMP)], ids=["none", "one", "two"])
def test_a_lean_model_has_the_same_coordinates_in_the_same_order(composition: Composition, added: tuple) -> None:
    full, lean = composition.with_asleep(composition.inside, added), composition.lean(added)
    assert lean.layout.free == full.layout.free
    assert set(lean.layout.types) == {*PAPER, *OF_RIG_TOML, *added}
    order = [composition.whole.layout.types.index(t) for t in lean.layout.types]
    assert order == sorted(order)
    assert {p.symbol for p in lean.layout.parameters} == {p.symbol for p in full.layout.parameters} - {
        s for e in composition.candidates if e not in added for s in resting(e)
    }
    x = typical(full)
    few = read(lean, x)
    assert few == {s: v for s, v in read(full, x).items() if s in few}
    assert few["B_m"] == 2e-5
    assert lean.layout.room == 0
