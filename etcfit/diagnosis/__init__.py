"""Close the loop: find the effects that the model lacks, add them, and report how much better it predicts held-out
traces.

Names are imported when they are first used, so that code which reads one threshold does not load the whole diagnosis.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .course import diagnose as diagnose
    from .findings import Diagnosis as Diagnosis
    from .settings import DiagnosisSettings as DiagnosisSettings

MODULE_OF = {"Diagnosis": "findings", "DiagnosisSettings": "settings", "diagnose": "course"}

__all__ = [*MODULE_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value
