"""A request for gains, the same for the command line, a notebook and the manifest of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..model.feed_forward import TermNames


@dataclass(frozen=True)
class DesignRequest:
    """A request for gains."""

    rule: str = "optimal"  # the rule whose gains are proposed
    adc_bits: int = 12  # resolution of the position sensor, over its travel
    feed_forward: TermNames = False  # terms ahead of the PID, see `model.feed_forward`
    limits: Mapping[str, float] = field(default_factory=dict)  # by field of `Requirements`; others have their defaults
    ecu: Mapping[str, float] = field(default_factory=dict)  # given fields of the ECU; see `control.design.ecu_of`
    profile: str | None = None  # name of the make of ECU, see `model.ecus`; None for none in particular
    log: Path | str | None = None  # log from the car whose setpoint is a further scenario; None for none
    # run folder of a fleet on whose units the gains must work; None for the one model alone
    parts: Path | str | None = None
    anyway: bool = False  # give the gains even where the model behind them is no estimate; see `Design.withheld`
    # gains that the ECU has now, in its own numbers, see `control.own_numbers`
    present: Mapping[str, float] = field(default_factory=dict)

    def recorded(self) -> dict[str, Any]:
        """The request by field, in the form in which the manifest of a run stores it to repeat it."""
        from ..model.feed_forward import as_recorded, terms_of

        files = {name: None if path is None else str(path) for name, path in (("log", self.log), ("parts", self.parts))}
        return asdict(self) | {"feed_forward": as_recorded(terms_of(self.feed_forward))} | files
