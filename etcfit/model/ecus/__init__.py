"""Engine computers, those with a public source and the others; registered here and nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ...errors import UsageError
from .closed import ECUMASTER, EMTRON, HALTECH, LINK, MAXXECU, MOTEC, SYVECS
from .open_source import ARDUINO, DBWX2, FOME, GENERIC, RUSEFI
from .profile import NOT_DIVIDED, BiasTable, EcuProfile, Limit, Pasting, Scheduling, differences

PROFILES = (
    RUSEFI, FOME, DBWX2, LINK, EMTRON, MAXXECU, ECUMASTER, HALTECH, MOTEC, SYVECS, ARDUINO, GENERIC,
)  # fmt: skip
ECUS: Mapping[str, EcuProfile] = MappingProxyType({profile.name: profile for profile in PROFILES})
"""Engine computers by the name for `--ecu`."""


def named(name: str) -> EcuProfile:
    """The engine computer with this name.

    Raises:
        UsageError: there is none.
    """
    if name not in ECUS:
        raise UsageError(f"{name}: no such engine computer. Known: {', '.join(ECUS)}.")
    return ECUS[name]


__all__ = [
    "ECUS",
    "NOT_DIVIDED",
    "PROFILES",
    "BiasTable",
    "EcuProfile",
    "Limit",
    "Pasting",
    "Scheduling",
    "differences",
    "named",
]
