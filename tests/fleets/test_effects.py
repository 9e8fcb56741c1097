"""Effects that the line's model declares: in which units they are, and how strong."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.fleets.statistics.effects import effects_in
from etcfit.fleets.statistics.stack import Stack


def test_an_effect_is_found_in_the_units_that_have_it() -> None:
    rng, n = np.random.default_rng(1), 200
    strength = np.where(np.arange(n) < 30, 1e-3, 0.0)
    estimate = np.column_stack([0.13 + 0.01 * rng.standard_normal(n), strength + 1e-4 * rng.standard_normal(n)])
    information = np.tile(np.diag([1e6, 1e8]), (n, 1, 1))
    information[199, 1, 1] = 0.0
    stack = Stack(tuple(f"u{u}" for u in range(n)), ("K_s", "D_q"), estimate, information)
    (found,) = effects_in(stack, ["quadratic_drag", "backlash", "return_spring"])
    assert found.effect == "quadratic_drag"
    assert found.symbol == "D_q"
    assert set(found.units) >= {f"u{u}" for u in range(30)}
    assert len(found.units) <= 33
    assert found.of == 199
    assert "u199" not in found.strength
    assert found.strength["u3"] == pytest.approx(1e-3, abs=5e-4)
    assert abs(found.median) < 1e-4


def test_an_effect_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="no effect is called friction_of_the_mind"):
        effects_in(Stack(("a",), ("x",), np.ones((1, 1)), np.ones((1, 1, 1))), ["friction_of_the_mind"])
