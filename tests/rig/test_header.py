"""A header is quantity and unit; what it lacks is said with its cure."""

from __future__ import annotations

import pytest

from etcfit.rig.header import HeaderError, parse_header


@pytest.mark.parametrize(
    ("header", "parsed"),
    [
        ("time [ms]", ("time", "ms")),
        ("  Motor Speed [ rpm ] ", ("motor_speed", "rpm")),
        ("position [%]", ("position", "%")),
        ("current [-1 A]", ("current", "-1 A")),
        ("time [1.02 s]", ("time", "1.02 s")),
    ],
)
def test_case_spaces_and_factors_are_understood(header: str, parsed: tuple[str, str]) -> None:
    assert parse_header(header) == parsed


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("voltage", r"column 'voltage' has no unit.*as in 'voltage \[V\]'"),
        ("voltage []", "has no unit"),
        ("voltage [A]", "column 'voltage \\[A\\]'.*Accepted: voltage in V"),
        ("voltag [V]", r"is not known.*\[columns\].*Did you mean 'voltage \[V\]'"),
        ("TP (Main) (V)", r"is not known.*under \[columns\], as \"TP \(Main\) \(V\)\" ="),
        ("voltage [%]", "Correct the unit"),
    ],
)
def test_what_is_missing_is_said_with_its_cure(header: str, said: str) -> None:
    with pytest.raises(HeaderError, match=said):
        parse_header(header)
