"""The unit of a column that names none, by how large its numbers are."""

from __future__ import annotations

from typing import NamedTuple


class UnitGuess(NamedTuple):
    """A quantity with its unit; `tps` may have become `position`, or the other way round."""

    quantity: str
    unit: str
    sure: bool


class _Range(NamedTuple):
    """Peaks up to this one are in this unit."""

    up_to: float
    quantity: str
    unit: str
    sure: bool


_END = float("inf")
# a position between 0 and 1 is a share of the usual 90 degrees
_RANGES: dict[str, tuple[_Range, ...]] = {
    "voltage": (_Range(40.0, "voltage", "V", True), _Range(150.0, "voltage", "V", False),
                _Range(_END, "voltage", "mV", True)),
    "current": (_Range(30.0, "current", "A", True), _Range(150.0, "current", "A", False),
                _Range(_END, "current", "mA", True)),
    "emf": (_Range(15.0, "emf", "V", True), _Range(60.0, "emf", "V", False), _Range(_END, "emf", "mV", True)),
    "supply": (_Range(60.0, "supply", "V", True), _Range(_END, "supply", "mV", True)),
    "tps": (_Range(6.0, "tps", "V", True), _Range(400.0, "position", "deg", False), _Range(_END, "tps", "mV", False)),
    "position": (_Range(1.06, "position", "90 deg", False), _Range(1.75, "position", "rad", False),
                 _Range(5.6, "tps", "V", False), _Range(96.0, "position", "deg", False),
                 _Range(110.0, "position", "%", False), _Range(_END, "tps", "mV", False)),
    "setpoint": (_Range(1.75, "setpoint", "rad", False), _Range(96.0, "setpoint", "deg", False),
                 _Range(_END, "setpoint", "%", False)),
    "motor_speed": (_Range(_END, "motor_speed", "rpm", False),),
    "duty": (_Range(1.05, "duty", "1", True), _Range(100.5, "duty", "%", True),
             _Range(255.5, "duty", f"{100 / 255:.10g} %", False), _Range(1023.5, "duty", f"{100 / 1023:.10g} %", False),
             _Range(_END, "duty", f"{100 / 4095:.10g} %", False)),
    "torque": (_Range(_END, "torque", "N m", False),),
    "temperature": (_Range(200.0, "temperature", "degC", True), _Range(_END, "temperature", "K", False)),
}  # fmt: skip


def unit_by_range(quantity: str, peak: float) -> UnitGuess:
    """The unit in which these numbers would be a rig's.

    Args:
        quantity: by its name.
        peak: largest magnitude.
    """
    found = next(each for each in _RANGES[quantity] if peak <= each.up_to)
    return UnitGuess(found.quantity, found.unit, found.sure)
