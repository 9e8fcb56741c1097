"""Engine computers, one file each, registered here and nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ...errors import UsageError
from .arduino import ARDUINO
from .dbwx2 import DBWX2
from .ecumaster import ECUMASTER
from .emtron import EMTRON
from .fome import FOME
from .generic import GENERIC
from .haltech import HALTECH
from .link import LINK
from .maxxecu import MAXXECU
from .motec import MOTEC
from .profile import NOT_DIVIDED, BiasTable, EcuProfile, Limit, Pasting, Scheduling, differences
from .rusefi import RUSEFI
from .syvecs import SYVECS

PROFILES = (
    RUSEFI, FOME, DBWX2, LINK, EMTRON, MAXXECU, ECUMASTER, HALTECH, MOTEC, SYVECS, ARDUINO, GENERIC,
)  # fmt: skip
ECUS: Mapping[str, EcuProfile] = MappingProxyType({profile.name: profile for profile in PROFILES})
"""By the name that `--ecu` takes."""


def named(name: str) -> EcuProfile:
    """The engine computer of a name.

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
