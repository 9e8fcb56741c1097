"""The current of the bench supply in the place of the motor's: i_s = d i, d = v / V_s.

A held winding then shows V/i = R V_s / V, less the higher the voltage is, which no winding does, and i_s V_s / v shows
the one resistance that it has. See `other_current.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real
from ..finding import Finding
from .base import AbstractDetector, Records
from .circuit import Value
from .other_current import OtherCurrent, supply_of


@dataclass(frozen=True)
class SupplyCurrent(AbstractDetector):
    """See the module.

    Args:
        times: how many times less the current of a supply must leave of the voltage than that of a motor. Where a test
            shows it, and none shows the opposite as clearly, every current is one of the supply.
        span: largest over smallest voltage of the windows, at least.
    """

    times: float = real(4.0, 1.0)
    span: float = real(1.5, 1.0)
    kind: ClassVar[str] = "supply_current"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        read = {test: current.better(current.supply, 0.9) for test, current in records.currents.items()
                if self._spans(current)}  # fmt: skip
        shown = {test: found for test, found in read.items() if found is not None and found[0] > self.times}
        opposed = any(found is None or found[0] < 1.0 / self.times for found in read.values())
        if opposed:
            yield from (self._finding(records, {test: found}, test) for test, found in shown.items())
        elif shown:
            yield self._finding(records, shown, None if len(records.currents) > 1 else next(iter(shown)))

    def _spans(self, current: OtherCurrent) -> bool:
        low, high = np.quantile(np.abs(current.motor.volts / current.motor.seconds), [0.05, 0.95])
        return bool(high > self.span * low)

    def _finding(self, records: Records, shown: Mapping[str, tuple[float, Value]], place: str | None) -> Finding:
        test = max(shown, key=lambda name: shown[name][0])
        times, R = shown[test]
        traces = [t for t in records.tests[test] if "current" in t.channels]
        channel, known = traces[0].channels["current"], supply_of(traces, records.config)
        motor = records.currents[test].motor
        high, low = np.quantile(
            np.abs(motor.volts / np.where(motor.amperes == 0.0, np.nan, motor.amperes)), [0.95, 0.05]
        )
        ohms = f", and R is {R.value:.4g} ohm" if known else ""
        found = (f"'{channel.header}' is the current of the supply, not of the motor: in {' and '.join(shown)} voltage "
                 f"over current falls as the voltage rises, in {test} from {high:.3g} to {low:.3g} ohm. Divided by the "
                 f"duty it leaves {times:.0f} times less of the voltage unexplained there{ohms}.")  # fmt: skip
        where = f"of {place}" if place else "of every test that logged it so"
        unknown = "" if known else " Write [rig] supply_V, the supply's voltage, in rig.toml."
        mend = (f"Head the column 'supply_current [{channel.unit}]' in each trace {where}, and it is divided by the "
                f"duty; or log the motor's own current.{unknown}")  # fmt: skip
        return Finding(self.kind, R.value if known else times, "ohm" if known else "", 0.0, found, mend, place,
                       channel="current")  # fmt: skip
