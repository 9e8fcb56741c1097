"""A mistake or a habit of the rig itself, found in its records."""

from __future__ import annotations

from dataclasses import dataclass

ALLOWED_FOR = frozenset({"synchronous_edges"})  # kinds that are a habit: the fit estimates what it is, nobody mends it


@dataclass(frozen=True)
class Finding:
    """What a detector found.

    Args:
        kind: of rig mistake, as in `series_resistance`; the names are part of the contract.
        size: how large, in `unit`; what it is of, the sentence says.
        unit: of the size; "" where it has none.
        chance: probability that a rig without the mistake would look so.
        found: one sentence: where, what was found, against what.
        mend: the line of rig.toml or the header of the CSV that mends it, or what to do where no line can.
        test, file, channel: where it lies; None: in all of them.
        sure: physics rules the data out, whatever the rig: no fit takes them.
    """

    kind: str
    size: float
    unit: str
    chance: float
    found: str
    mend: str
    test: str | None = None
    file: str | None = None
    channel: str | None = None
    sure: bool = False

    @property
    def where(self) -> str:
        """File or test, and channel, for a table."""
        return " ".join(part for part in (self.file or self.test or "rig", self.channel) if part)

    def __str__(self) -> str:
        return f"{self.kind}: {self.found} {self.mend}"
