"""MATLAB: a .mat file, and a script that builds the transfer function."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from ...rig.user_text import matlab_comment, one_line
from ..base import Export, Format, Source
from ..linear import cannot_hold, gains


def _mat(source: Source) -> Export:
    from scipy.io import savemat

    lost, reduction = (*source.cautions, *cannot_hold(source)), source.reduction
    plant, stderr = reduction.plant, np.asarray(reduction.stderr, dtype=float)
    content: dict[str, Any] = {
        "rig": source.title,
        "origin": source.origin,
        "notes": np.array(lost, dtype=object),
        "synthetic": bool(source.fitted.config.synthetic),
        "effects": np.array([effect.name for effect in source.effects], dtype=object),
        "parameters": {p.symbol: source.values[p.symbol] for p in source.parameters} | dict(source.body),
        "units": {p.symbol: p.unit for p in source.parameters} | {"N": "1", "lower": "rad", "upper": "rad"},
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
    if found := gains(source):
        content["gains"] = found
    packed = io.BytesIO()
    savemat(packed, {"etcfit": content}, long_field_names=True, oned_as="row")
    return Export({"etcfit.mat": packed.getvalue()}, lost)


def _script(source: Source) -> Export:
    lost = (*source.cautions, *cannot_hold(source))
    text = "\n".join((matlab_comment((source.title, source.origin, *lost)), "", *_lines(source), ""))
    return Export({"etcfit_model.m": text}, lost)


def _lines(source: Source) -> Iterator[str]:
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
    for name, value in gains(source).items():
        yield f"{name} = {value!r}; % {dict(Kp='V/rad', Ki='V/(rad s)', Kd='V s/rad')[name]}, of etcfit design"
    yield from ("if exist('tf', 'file') || exist('tf', 'builtin')", "    G = tf(num, conv(den, [lag, 1]));",
                "    G.InputDelay = delay;", "end")  # fmt: skip


MAT = Format("mat", "MATLAB data: parameters and transfer function", _mat)
SCRIPT = Format("m", "MATLAB or Octave script of the same", _script)
