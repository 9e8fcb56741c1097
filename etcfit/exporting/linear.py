"""The linear plant and its omissions: MATLAB's .mat, the same as a script, and Python without etcfit."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..model.effects.electrical import ActuationDelay
from ..model.effects.sensors import PositionSensorLag
from ..rig.user_text import matlab_comment, one_line, python_comment
from .base import BODY, Export, Format, Source, rendered

_KEPT = (ActuationDelay, PositionSensorLag)  # written in addition to the transfer function
_GAIN_UNITS = {"Kp": "V/rad", "Ki": "V/(rad s)", "Kd": "V s/rad"}


def _cannot_hold(source: Source) -> Iterator[str]:
    """Sentences on what a transfer function leaves out."""
    yield from source.cautions
    reduction = source.reduction
    place = f"{100.0 * reduction.share:.0f} % of the travel ({reduction.theta:.4g} rad, {reduction.volts:.4g} V)"
    yield f"The transfer function holds near {place}: dry friction, preload and the stops have none."
    if bent := [effect.name for effect in source.beyond_the_paper if effect not in _KEPT]:
        yield (f"Of {', '.join(bent)} only the slope at that place is in it, and the memory of an effect stays "
               "still. The formats c and fmu hold them.")  # fmt: skip


def _gains(source: Source) -> dict[str, float]:
    """Gains by name; {} if none were designed."""
    return {} if source.designed is None else source.designed._asdict()


def _mat(source: Source) -> Export:
    from scipy.io import savemat

    lost, reduction = tuple(_cannot_hold(source)), source.reduction
    plant, stderr = reduction.plant, np.asarray(reduction.stderr, dtype=float)
    content: dict[str, Any] = {
        "rig": source.title,
        "origin": source.origin,
        "notes": np.array(lost, dtype=object),
        "synthetic": bool(source.fitted.config.synthetic),
        "effects": np.array([effect.name for effect in source.effects], dtype=object),
        "parameters": {p.symbol: source.values[p.symbol] for p in source.parameters} | dict(source.body),
        "units": {p.symbol: p.unit for p in source.parameters} | {symbol: unit for symbol, (unit, _) in BODY.items()},
        "transfer_function": {
            "num": np.array(plant.num, dtype=float),
            "den": np.array(plant.den, dtype=float),
            "num_stderr": stderr[:1],
            "den_stderr": np.concatenate(([0.0], stderr[1:])),
            "input": "V",
            "output": "rad",
            "delay_s": float(plant.delay),
            "sensor_lag_s": float(plant.lag),
            "position_rad": reduction.theta,
            "voltage_V": reduction.volts,
            "current_A": reduction.current,
        },
    }
    if found := _gains(source):
        content["gains"] = found
    packed = io.BytesIO()
    savemat(packed, {"etcfit": content}, long_field_names=True, oned_as="row")
    return Export({"etcfit.mat": packed.getvalue()}, lost)


def _script(source: Source) -> Export:
    lost = tuple(_cannot_hold(source))
    text = "\n".join((matlab_comment((source.title, source.origin, *lost)), "", *_matlab_lines(source), ""))
    return Export({"etcfit_model.m": text}, lost)


def _matlab_lines(source: Source) -> Iterator[str]:
    plant = source.reduction.plant
    yield "% parameters, SI"
    for p in source.parameters:
        yield f"p.{p.symbol} = {source.values[p.symbol]!r}; % {p.unit}: {one_line(p.meaning)}"
    for symbol, value in source.body.items():
        yield f"p.{symbol} = {value!r};"
    yield from ("", "% rad/V: num / den, and behind it exp(-delay s) / (lag s + 1)")
    yield f"num = [{', '.join(repr(float(each)) for each in plant.num)}];"
    yield f"den = [{', '.join(repr(float(each)) for each in plant.den)}];"
    yield f"delay = {float(plant.delay)!r}; % s"
    yield f"lag = {float(plant.lag)!r}; % s"
    for name, value in _gains(source).items():
        yield f"{name} = {value!r}; % {_GAIN_UNITS[name]}, of etcfit design"
    yield from ("if exist('tf', 'file') || exist('tf', 'builtin')", "    G = tf(num, conv(den, [lag, 1]));",
                "    G.InputDelay = delay;", "end")  # fmt: skip


def _python(source: Source) -> Export:
    lost, plant = tuple(_cannot_hold(source)), source.reduction.plant
    quantities = [(p.symbol, source.values[p.symbol], p.unit, p.meaning) for p in source.parameters]
    quantities += [(symbol, value, *BODY[symbol]) for symbol, value in source.body.items()]
    text = rendered(
        "model.py.txt", notes=python_comment((source.title, source.origin, *lost)), quantities=quantities,
        gains=_gains(source), num=[float(each) for each in plant.num], den=[float(each) for each in plant.den],
        delay=float(plant.delay), lag=float(plant.lag),
    )  # fmt: skip
    return Export({"etcfit_model.py": text}, lost)


MAT = Format("mat", "MATLAB data: parameters and transfer function", _mat)
SCRIPT = Format("m", "MATLAB or Octave script of the same", _script)
PYTHON = Format("python", "Python snippet for scipy.signal and python-control", _python)
