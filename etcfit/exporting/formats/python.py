"""A Python file without etcfit: parameters, scipy.signal.lti, and python-control where it is installed."""

from __future__ import annotations

from ...rig.user_text import python_comment
from ..base import Export, Format, Source
from ..linear import cannot_hold, gains
from ..rendering import rendered


def _export(source: Source) -> Export:
    lost, plant = (*source.cautions, *cannot_hold(source)), source.reduction.plant
    numbers = {
        "num": [float(each) for each in plant.num],
        "den": [float(each) for each in plant.den],
        "delay": float(plant.delay),
        "lag": float(plant.lag),
    }
    quantities = [(p.symbol, source.values[p.symbol], p.unit, p.meaning) for p in source.parameters]
    rig = {"N": ("1", "gear ratio"), "lower": ("rad", "closed stop"), "upper": ("rad", "open stop")}
    quantities += [(symbol, value, *rig[symbol]) for symbol, value in source.body.items()]
    notes = python_comment((source.title, source.origin, *lost))
    text = rendered("model.py.txt", notes=notes, quantities=quantities, gains=gains(source), **numbers)
    return Export({"etcfit_model.py": text}, lost)


FORMAT = Format("python", "Python snippet for scipy.signal and python-control", _export)
