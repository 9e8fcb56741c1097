"""Every registered effect, whoever wrote it: units, domains, an exact off value, and what it says of itself."""

from __future__ import annotations

import inspect
from itertools import pairwise

import numpy as np
import pint
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from effect_samples import AXES, contribution, every_effect, rows, seen, table
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS, PAPER, AbstractEffect, Contribution, total
from etcfit.model.parameters import Positive, parameters_of

UNITS = pint.UnitRegistry()
BEYOND = [effect for effect in EFFECTS if effect not in PAPER]
every_addition = pytest.mark.parametrize("effect", BEYOND, ids=lambda effect: effect.name)
every_amplitude = pytest.mark.parametrize(
    ("effect", "symbol"), [pytest.param(e, s, id=f"{e.name}-{s}") for e in BEYOND for s in e.off or {}]
)


def off(effect: type[AbstractEffect]) -> dict[str, float]:
    return dict(effect.off or {})


def shape(effect: type[AbstractEffect]) -> list[str]:
    """Its parameters that are not amplitudes."""
    return [p.symbol for p in parameters_of(effect) if p.symbol not in off(effect)]


def loudest(effect: type[AbstractEffect], at: np.ndarray) -> float:
    """The largest thing it contributes at any of these rows, the rates of its memory left out."""
    return max(float(np.max(np.abs(v))) for v in seen(effect, at).values())


# ---- declarations


@every_effect
def test_is_named_and_documented_with_its_source_what_it_needs_and_whether_it_is_ever_off(
    effect: type[AbstractEffect],
) -> None:
    assert effect.name == effect.name.lower()
    assert EFFECT_BY_NAME[effect.name] is effect
    text = inspect.getdoc(effect) or ""
    assert "Source:" in text
    assert "Differs from source:" in text
    assert set(effect.needs) <= {"circuit", "current", "position", "gear", "bridge"}
    assert (effect.off is None) == (effect in PAPER), "an effect beyond Eqs. 1-2 needs a value at which it vanishes"


@every_effect
def test_parameters_have_unit_meaning_and_source_and_survive_their_domain(effect: type[AbstractEffect]) -> None:
    """value(coordinate(v)) = v from a hundredth of the scale to a hundredfold of it."""
    for parameter in parameters_of(effect):
        assert UNITS.parse_units(parameter.unit.replace("m2", "m**2")) is not None
        assert parameter.meaning.strip()
        assert parameter.source.strip()
        domain = parameter.domain
        scale = getattr(domain, "scale", 1.0)
        inside = domain.inside(parameter.nominal)
        for v in (inside, *(scale * np.geomspace(0.01, 100.0, 9))):
            there = float(domain.value(domain.coordinate(float(v))))
            assert_allclose(there, v, rtol=1e-9, atol=1e-12 * scale, err_msg=parameter.symbol)


# ---- off


@every_addition
def test_is_off_at_its_off_value(effect: type[AbstractEffect]) -> None:
    """Exactly nothing in every part, whatever its shape and its memory, so that models nest."""
    for stretch in (0.1, 1.0, 10.0):
        shaped = {p.symbol: stretch * 0.5 * getattr(p.domain, "scale", 1.0) for p in parameters_of(effect)}
        at = rows(effect, **(shaped | off(effect)))
        for name, value in seen(effect, at).items():
            assert_array_equal(value, 0.0, err_msg=name)
        for row in at[:3]:
            c = contribution(effect, row)
            assert not np.isfinite(c.lower)
            assert not np.isfinite(c.upper)


@every_amplitude
def test_each_off_symbol_is_an_amplitude(effect: type[AbstractEffect], symbol: str) -> None:
    """On its own, with all others off, it makes the effect heard: a shape parameter could not."""
    others = {s: v for s, v in off(effect).items() if s != symbol}
    domain = next(p.domain for p in parameters_of(effect) if p.symbol == symbol)
    assert off(effect)[symbol] == 0.0
    assert not isinstance(domain, Positive), "zero is out of reach in this domain"
    assert loudest(effect, rows(effect, **others)) > 0.0


@every_addition
def test_starts_at_its_off_value(effect: type[AbstractEffect]) -> None:
    """The nominal value of an amplitude is its off value: an effect nobody measured is assumed away."""
    nominal = {p.symbol: p.nominal for p in parameters_of(effect)}
    assert {s: nominal[s] for s in off(effect)} == off(effect)


# ---- scan


@every_addition
def test_scans_shapes_and_impacts_which_the_stepper_cuts_off_while_they_are_small(effect: type[AbstractEffect]) -> None:
    impacts = any(np.any(seen(effect, rows(effect))[part] != 0.0) for part in ("restitution", "play"))
    assert set(effect.scan) <= set(shape(effect)) | (set(off(effect)) if impacts else set())


@pytest.mark.parametrize("effect", [e for e in BEYOND if e.scan], ids=lambda effect: effect.name)
def test_a_scanned_value_is_allowed_and_makes_a_difference(effect: type[AbstractEffect]) -> None:
    domains = {p.symbol: p.domain for p in parameters_of(effect)}
    for symbol, values in effect.scan.items():
        assert list(values) == sorted(set(values))
        there = [domains[symbol].value(domains[symbol].coordinate(v)) for v in values]
        assert_allclose(np.array(there, float), values, rtol=1e-9)
        tables = [table(effect, rows(effect, **{symbol: v})) for v in values]
        assert all(np.any(a != b) for a, b in pairwise(tables))


# ---- what it says of itself


@every_effect
def test_memory_and_rates_match_and_friction_is_a_budget(effect: type[AbstractEffect]) -> None:
    assert len(contribution(effect, rows(effect)[0]).dz) == len(effect.z0)
    assert np.all(seen(effect, rows(effect))["friction"] >= 0.0)


@every_effect
def test_only_a_loaded_effect_depends_on_what_the_gear_carries(effect: type[AbstractEffect]) -> None:
    at = rows(effect)
    elsewhere = at.copy()
    elsewhere[:, [AXES.index("motor"), AXES.index("external")]] = 0.01
    changed = np.any(table(effect, at) != table(effect, elsewhere))
    assert bool(changed) == effect.loaded


@every_effect
def test_only_an_effect_that_delays_shifts_in_time(effect: type[AbstractEffect]) -> None:
    """And by a constant: a delay that depended on the state could not be taken out of the batch."""
    late = [v for name, v in seen(effect, rows(effect)).items() if name.endswith("_delay")]
    assert any(np.any(v != 0.0) for v in late) == effect.delays
    assert all(np.ptp(v) == 0.0 and np.all(v >= 0.0) for v in late)


@every_effect
def test_a_stop_stays_where_it_is(effect: type[AbstractEffect]) -> None:
    """`lower` and `upper` are the rig's, whatever the state and the parameters."""
    limits = {(float(c.lower), float(c.upper)) for c in (contribution(effect, row) for row in rows(effect)[:6])}
    stretched = contribution(effect, np.concatenate((rows(effect)[0][: len(AXES)], 3.0 * rows(effect)[0][len(AXES) :])))
    assert limits == {(float(stretched.lower), float(stretched.upper))}


@every_effect
def test_a_motor_alone_feels_nothing_of_the_plate(effect: type[AbstractEffect]) -> None:
    """With the gear apart the angle means nothing: no effect may depend on it, nor stop it."""
    at = rows(effect)
    elsewhere = at.copy()
    elsewhere[:, AXES.index("theta")] += 0.7
    here, there = seen(effect, at, plate=0.0), seen(effect, elsewhere, plate=0.0)
    for name in here:
        assert_allclose(here[name], there[name], rtol=1e-14, atol=0.0, err_msg=name)
    assert_array_equal(here["position"], 0.0)
    c = contribution(effect, at[0], plate=0.0)
    assert not np.isfinite(c.lower)
    assert not np.isfinite(c.upper)


def test_total_adds_torques_and_takes_the_tightest_stop() -> None:
    a = Contribution(torque=1.0, friction=0.1, voltage=2.0, lower=0.1, dz=(5.0,))
    b = Contribution(torque=-3.0, drive=0.7, inertia=4.0, lower=-1.0, upper=2.0, current_delay=0.3, dz=(6.0, 7.0))
    expected = Contribution(-2.0, 0.7, 0.1, 2.0, 4.0, lower=0.1, upper=2.0, current_delay=0.3, dz=(5.0, 6.0, 7.0))
    assert total([a, b]) == expected
