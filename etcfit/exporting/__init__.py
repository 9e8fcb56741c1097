"""Export: a fitted model in the formats of other programs, one writer per format; each states what it cannot hold.

Formats are registered only here.
"""

from __future__ import annotations

from ..errors import UsageError
from . import fmu, joint, linear, plant, tune
from .base import Export, ExportSettings, Format, Source, write

FORMATS: tuple[Format, ...] = (
    plant.C, fmu.FMU, tune.MSQ, linear.MAT, linear.SCRIPT, linear.PYTHON, joint.MUJOCO, joint.POSITION, joint.ISAAC
)  # fmt: skip
_BY_NAME = {format_.name: format_ for format_ in FORMATS}


def named(name: str) -> Format:
    """The format with this name.

    Raises:
        UsageError: there is no such format.
    """
    if name not in _BY_NAME:
        known = "; ".join(f"{each.name} ({each.title})" for each in FORMATS)
        raise UsageError(f"--to {name}: no such format. Known: {known}.")
    return _BY_NAME[name]


__all__ = ["FORMATS", "Export", "ExportSettings", "Format", "Source", "named", "write"]
