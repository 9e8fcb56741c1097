"""The usual units, which are answered without pint, are what pint makes of them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from etcfit.rig.units import SI_UNIT, USUAL, Conversion, by_pint, conversion


@pytest.mark.parametrize(("wanted", "logged"), USUAL, ids=" from ".join)
def test_a_usual_unit_is_what_pint_makes_of_it(wanted: str, logged: str) -> None:
    quantities = [quantity for quantity, unit in SI_UNIT.items() if unit == wanted]
    assert quantities
    for quantity in quantities:
        assert conversion(quantity, logged) == by_pint(quantity, logged)


def test_other_units_still_come_from_pint() -> None:
    assert conversion("current", "kA") == Conversion(1000.0)
    assert conversion("motor_speed", "deg/s") == by_pint("motor_speed", "deg/s")


@pytest.mark.slow
def test_the_usual_units_do_not_load_pint() -> None:
    asked = "[conversion(*each) for each in (('voltage', 'mV'), ('position', 'degrees'), ('motor_speed', 'U/min'))]"
    code = f"import sys; from etcfit.rig.units import conversion; {asked}; print('pint' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
