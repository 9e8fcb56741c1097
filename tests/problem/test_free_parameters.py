"""Which parameters are free, fixed or tied, as rig.toml says."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import replace

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.errors import MeasurementError
from etcfit.model.effects import PAPER
from etcfit.problem.free_parameters import SERIES, Form, FreeParameters, Layout, free_parameters
from etcfit.rig.base import Fixed, Knowledge, Prior, RigConfig, Start, Tied

PAPER_SYMBOLS = ("R_a", "L_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")


def known(parameters: Mapping[str, Knowledge] | None = None, **config: object) -> FreeParameters:
    return free_parameters(RigConfig("bench", parameters=parameters or {}, **config))  # pyright: ignore[reportArgumentType]


def test_a_bare_rig_has_the_papers_parameters_and_one_tie() -> None:
    layout = known().layout
    assert layout.types == PAPER
    assert tuple(p.symbol for p in layout.parameters) == PAPER_SYMBOLS
    assert layout.free == tuple(s for s in PAPER_SYMBOLS if s != "K_m")
    assert layout.ties == (("K_m", "K_b"),)
    assert layout.held == ()


def test_values_come_from_coordinates_fixed_values_and_ties() -> None:
    u = known({"K_s": Fixed(0.2), "T_f": Tied("T_PL")})
    typical = {s: p.nominal or 1e-3 for s, p in zip(PAPER_SYMBOLS, u.layout.parameters, strict=True)}
    values = u.layout.values(u.layout.coordinates(typical), u.held)
    assert set(values) == set(PAPER_SYMBOLS)
    assert values["K_s"] == 0.2
    assert_allclose([float(values[s]) for s in u.layout.free], [typical[s] for s in u.layout.free], rtol=1e-9)
    assert float(values["T_f"]) == float(values["T_PL"])
    assert [u.layout.status(s) for s in ("K_s", "T_f", "K_m", "R_a")] == ["fixed", "tied", "tied", "estimated"]


def test_any_knowledge_of_k_m_but_the_tie_frees_it() -> None:
    for knowledge in (Start(0.02), Prior(0.02, 0.001)):
        assert "K_m" in known({"K_m": knowledge}).layout.free


def test_priors_and_starts_are_kept_apart() -> None:
    u = known({"J_L": Prior(1e-3, 2e-4), "R_a": Start(1.4), "B_L": Fixed(0.0)})
    assert u.priors == {"J_L": (1e-3, 2e-4)}
    assert u.start == {"J_L": 1e-3, "R_a": 1.4, "B_L": 0.0}
    assert u.layout.held == ("B_L",)
    assert_array_equal(u.held, [0.0])


def test_a_test_has_a_circuit_of_its_own() -> None:
    u = known(series_ohm={"inductance": None, "sine": 0.4})
    assert SERIES + "inductance" in u.layout.free
    assert SERIES + "sine" in u.layout.held
    assert_array_equal(u.held, [0.4])


def test_an_effect_named_in_rig_toml_brings_its_parameters() -> None:
    layout = known(effects=("gravity_load",)).layout
    assert "T_g" in layout.free
    assert len(layout.types) == len(PAPER) + 1
    assert known(effects=("return_spring",)).layout.types == PAPER  # it is there already


def test_layouts_of_one_form_are_equal_so_that_they_compile_once() -> None:
    a, b = known({"K_s": Fixed(0.1)}).layout, known({"K_s": Fixed(0.2)}).layout
    assert a == b
    assert hash(a) == hash(b)


def test_a_form_takes_no_hash_to_another_process() -> None:
    """Which hashes its strings otherwise: an equal form there would be another key."""
    form = known().layout.form
    assert hash(form) == hash(known().layout.form)
    other = pickle.loads(pickle.dumps(form))
    assert other == form
    assert vars(other) == {"types": form.types, "parameters": form.parameters, "ties": form.ties}


def test_a_start_on_a_bound_moves_off_it_and_others_stay() -> None:
    """A parameter that starts at its bound does not move."""
    layout = known().layout
    start = {s: 0.3 for s in PAPER_SYMBOLS} | {"B_L": 0.0, "B_m": 0.0}
    x = layout.coordinates(start)
    moved = layout.off_bounds(x)
    changed = {s for s, a, b in zip(layout.free, x, moved, strict=True) if a != b}
    assert changed == {"B_L", "B_m"}
    assert all(not layout.parameter(s).domain.at_bound(float(layout.values(moved, np.zeros(0))[s])) for s in changed)


def test_reach_is_a_change_of_a_hundred_percent() -> None:
    layout = known().layout
    x = layout.coordinates({s: 0.3 for s in PAPER_SYMBOLS} | {"T_f": 0.02, "T_PL": 4.0})
    reach = dict(zip(layout.free, layout.reach(x), strict=True))
    assert reach["R_a"] == 1.0
    assert_allclose(reach["T_PL"], 10.0)
    assert reach["T_f"] == 1.0
    assert np.all(layout.reach(x) >= 1.0)


def test_a_distance_of_logarithms_is_exact_for_a_ratio_however_far() -> None:
    """R_a is the exponential of its coordinate, K_s and T_f are nearly in proportion to theirs, T_PL has either
    sign."""
    layout, held = known().layout, known().held
    here = {s: 0.3 for s in PAPER_SYMBOLS} | {"T_f": 0.2, "T_PL": 4.0}
    there = here | {"R_a": 1.2, "T_f": 0.6, "K_s": 0.05, "T_PL": -1.0}
    x, other = layout.coordinates(here), layout.coordinates(there)
    value, slope = layout.numbers(x)
    change = dict(zip(layout.free, layout.log_distance(x, other) * slope / value, strict=True))
    for symbol in ("R_a", "T_f", "K_s"):
        assert_allclose(change[symbol], np.log(there[symbol] / here[symbol]), rtol=1e-9)
    assert_allclose(change["T_PL"], -5.0 / 4.0)
    bound = layout.coordinates(here | {"T_f": 0.0})  # a logarithm would be far too long there
    moved = dict(zip(layout.free, layout.log_distance(x, bound), strict=True))
    assert_allclose(moved["T_f"], (bound - x)[layout.free.index("T_f")])
    assert layout.values(other, held)["T_PL"] == -1.0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"K_x": Fixed(1.0)}, "names 'K_x'.*This model has: R_a"),
        ({"K_m": Tied("K_x")}, "ties K_m to 'K_x'"),
        ({"K_s": Tied("K_m")}, "ties K_s to 'K_m'"),
        ({"K_m": Tied("K_m")}, "ties K_m to 'K_m'"),
        ({"R_a": Fixed(-1.5)}, "R_a is -1.5 ohm"),
        ({"R_a": Fixed(0.0)}, "R_a is 0 ohm"),
        ({"K_s": Prior(-0.1, 0.1)}, "K_s is -0.1 "),
        ({"J_L": Start(1e90)}, r"J_L is 1e\+90 kg"),
        ({"J_m": Fixed(0.0)}, "J_m is 0 kg"),
        ({s: Fixed(1e-3) for s in PAPER_SYMBOLS}, "nothing is left to fit"),
        ({s: Fixed(1e-3) if s == "R_a" else Tied("R_a") for s in PAPER_SYMBOLS}, "nothing is left to fit"),
    ],
)
def test_what_cannot_be_is_an_error_with_its_cure(parameters: Mapping[str, Knowledge], message: str) -> None:
    with pytest.raises(MeasurementError, match=message) as caught:
        known(parameters)
    assert caught.value.where == "rig.toml: [parameters]"
    assert caught.value.mend


def test_an_unknown_effect_is_an_error_that_names_the_known_ones() -> None:
    with pytest.raises(MeasurementError, match=r"names 'gravity_lode'.*gravity_load"):
        known(effects=("gravity_lode",))


def test_an_effect_named_twice_is_an_error_and_not_an_effect_of_twice_the_size() -> None:
    for name in ("gravity_load", "return_spring"):
        with pytest.raises(MeasurementError, match=f"names '{name}' 2 times. An effect acts once."):
            known(effects=(name, "limp_home_spring", name))


def test_one_free_parameter_is_enough_to_fit() -> None:
    assert known({s: Fixed(1e-3) for s in PAPER_SYMBOLS if s != "T_f"}).layout.free == ("T_f",)


def test_the_gear_ratio_is_no_parameter_of_the_fit() -> None:
    assert "N" not in known({"N": Fixed(20.0)}).layout.held


# ---- what a compiled model depends on, and what is data to it

read = jax.jit(Form.values, static_argnums=0)  # values in SI by symbol


def typical(layout: Layout) -> np.ndarray:
    """Coordinates of nominal values, of 1e-3 where those are zero."""
    return layout.coordinates({p.symbol: p.nominal or 1e-3 for p in layout.parameters})


def padded(u: FreeParameters, room: int) -> FreeParameters:
    return replace(u, layout=replace(u.layout, room=room))


TIED = {"K_s": Fixed(0.2), "T_f": Tied("T_PL"), "B_L": Tied("K_s")}


def test_a_form_gives_the_values_of_its_layout_ties_to_free_and_to_held_ones_included() -> None:
    u = known(TIED, series_ohm={"inductance": None, "sine": 0.4})
    layout, x = u.layout, typical(u.layout)
    values, expected = read(layout.form, x, layout.pick(u.held)), layout.values(x, u.held)
    assert set(values) == set(expected) == {p.symbol for p in layout.parameters}
    assert_allclose([float(values[s]) for s in expected], [float(v) for v in expected.values()], rtol=1e-15)
    assert float(values["T_f"]) == float(values["T_PL"])
    assert float(values["B_L"]) == float(values["K_s"]) == 0.2
    assert float(values[SERIES + "sine"]) == 0.4


def test_padding_stands_for_nothing() -> None:
    """Whatever stands in it, it moves no value, and no value feels it."""
    u = padded(known(TIED), 16)
    layout, x = u.layout, typical(u.layout)
    pick = layout.pick(u.held)
    assert layout.spare == 16 - len(layout.free) > 0
    assert_array_equal(pick.where[: x.size], [layout.form.index[s] for s in layout.free])
    assert_array_equal(pick.where[x.size :], len(layout.parameters))
    bare = read(layout.form, x, replace(layout, room=0).pick(u.held))
    for filler in (0.0, 7.7, -1e3):
        values = read(layout.form, layout.padded(x, filler), pick)
        assert {s: float(v) for s, v in values.items()} == {s: float(v) for s, v in bare.items()}
    slopes = jax.jacfwd(read, argnums=1)(layout.form, layout.padded(x, 3.0), pick)
    every = np.stack([np.asarray(slopes[p.symbol]) for p in layout.parameters])
    assert np.all(np.any(every[:, : x.size] != 0.0, axis=0))
    assert_array_equal(every[:, x.size :], 0.0)


def test_padding_fills_the_last_axis_up_to_the_room_and_no_further() -> None:
    layout = padded(known(), 16).layout
    assert_array_equal(layout.padded(np.ones((2, 10)), np.inf), [[1.0] * 10 + [np.inf] * 6] * 2)
    for room in (0, 10):
        assert replace(layout, room=room).spare == 0
        assert_array_equal(replace(layout, room=room).padded(np.ones(10)), np.ones(10))


def test_another_choice_of_free_parameters_is_the_same_form_and_compiles_nothing() -> None:
    """A symbol that is fixed, free or padded away is data; an effect or a tie is another program."""
    some, others = padded(known(), 16), padded(known({"K_s": Fixed(0.2), "T_f": Fixed(0.1)}), 16)
    assert some.layout != others.layout
    assert some.layout.form == others.layout.form
    assert hash(some.layout.form) == hash(others.layout.form)
    sizes = []
    for u in (some, others):
        x = u.layout.padded(typical(u.layout))
        values = read(u.layout.form, x, u.layout.pick(u.held))
        sizes.append(read._cache_size())  # pyright: ignore[reportAttributeAccessIssue]
    assert float(values["K_s"]) == 0.2
    assert sizes[0] == sizes[1]
    assert known(TIED).layout.form != known().layout.form
    assert known(effects=("gravity_load",)).layout.form != known().layout.form


def test_a_held_value_reaches_the_model_as_data() -> None:
    u = known({"K_s": Fixed(0.2)})
    full = u.layout.pick(u.held).full
    assert full[u.layout.form.index["K_s"]] == 0.2
    assert np.count_nonzero(full) == 1
    changed = read(u.layout.form, typical(u.layout), u.layout.pick(np.array([0.3])))
    assert float(changed["K_s"]) == 0.3
