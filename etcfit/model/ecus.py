"""Engine computers whose throttle controller is public: what their own source fixes, by name and field of `Ecu`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from .ecu import Ecu

RUSEFI: Mapping[str, float] = MappingProxyType({"period": 2e-3, "filter": 0.0, "duty": 0.9, "integral": 0.3})
"""rusEFI: 500 Hz, a derivative of the error without a filter, an integral within +-30 % of duty (its default; it is a
setting there), duty within +-90 %.

Source: rusEFI, firmware of 2022, electronic_throttle.cpp (ETB_DUTY_LIMIT, etb_iTermMin, etb_iTermMax),
electronic_throttle_impl.h (ETB_LOOP_FREQUENCY) and efi_pid.cpp (getUnclampedOutput, updateITerm)."""

ECUS: Mapping[str, Mapping[str, float]] = MappingProxyType({"rusefi": RUSEFI})


def differences(ecu: Ecu, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """Fields in which an ECU differs from one whose source fixes some."""
    return tuple(field for field, value in fixed.items() if abs(getattr(ecu, field) - value) > 1e-9)
