"""Formats: one file each, registered here and nowhere else."""

from __future__ import annotations

from ...errors import UsageError
from ..base import Format
from . import c, fmu, isaac, matlab, mujoco, python, tune

FORMATS: tuple[Format, ...] = (
    c.FORMAT,
    fmu.FORMAT,
    tune.FORMAT,
    matlab.MAT,
    matlab.SCRIPT,
    python.FORMAT,
    mujoco.FORMAT,
    mujoco.POSITION,
    isaac.FORMAT,
)
_BY_NAME = {format_.name: format_ for format_ in FORMATS}


def named(name: str) -> Format:
    """The format of a name.

    Raises:
        UsageError: there is none.
    """
    if name not in _BY_NAME:
        known = "; ".join(f"{each.name} ({each.title})" for each in FORMATS)
        raise UsageError(f"--to {name}: no such format. Known: {known}.")
    return _BY_NAME[name]
