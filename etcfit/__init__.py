"""Parameters, missing physics and PID gains of an electronic throttle body, from a folder of rig measurements.

Names are imported when they are first used, so that `import etcfit` costs nothing and `etcfit --help` answers at once.
Functions that share their name with a module are imported from that module: `from etcfit.fit import fit`.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# the model is stiff and the fit compares nested models: 32 bit is not enough. Read by JAX when it is first imported
os.environ.setdefault("JAX_ENABLE_X64", "1")

if TYPE_CHECKING:
    from .design import Design as Design
    from .diagnose import Diagnosis as Diagnosis
    from .effects import EFFECTS as EFFECTS
    from .effects import AbstractEffect as AbstractEffect
    from .effects import Contribution as Contribution
    from .errors import MeasurementError as MeasurementError
    from .errors import UsageError as UsageError
    from .fetch import DATASETS as DATASETS
    from .fetch import Dataset as Dataset
    from .fit import FitResult as FitResult
    from .fitted import Fitted as Fitted
    from .linear import TransferFunction as TransferFunction
    from .parameters import Parameter as Parameter
    from .parameters import parameter as parameter
    from .pid import RULES as RULES
    from .pid import Gains as Gains
    from .pid import Requirements as Requirements
    from .report import write_design as write_design
    from .report import write_diagnosis as write_diagnosis
    from .report import write_reduction as write_reduction
    from .report import write_run as write_run
    from .rig import TESTS as TESTS
    from .rig.base import AbstractRigTest as AbstractRigTest
    from .rig.base import Boundary as Boundary
    from .rig.base import Channel as Channel
    from .rig.base import Fixed as Fixed
    from .rig.base import Measurement as Measurement
    from .rig.base import Prior as Prior
    from .rig.base import Reading as Reading
    from .rig.base import Rig as Rig
    from .rig.base import RigConfig as RigConfig
    from .rig.base import Start as Start
    from .rig.base import Tied as Tied
    from .rig.reader import read_folder as read_folder

_MODULE_OF = {
    "EFFECTS": "effects",
    "TESTS": "rig",
    "DATASETS": "fetch",
    "RULES": "pid",
    "AbstractEffect": "effects",
    "AbstractRigTest": "rig.base",
    "Boundary": "rig.base",
    "Channel": "rig.base",
    "Contribution": "effects",
    "Dataset": "fetch",
    "Design": "design",
    "Diagnosis": "diagnose",
    "FitResult": "fit",
    "Fitted": "fitted",
    "Fixed": "rig.base",
    "Gains": "pid",
    "Measurement": "rig.base",
    "MeasurementError": "errors",
    "Parameter": "parameters",
    "Prior": "rig.base",
    "Reading": "rig.base",
    "Requirements": "pid",
    "Rig": "rig.base",
    "RigConfig": "rig.base",
    "Start": "rig.base",
    "Tied": "rig.base",
    "TransferFunction": "linear",
    "UsageError": "errors",
    "parameter": "parameters",
    "read_folder": "rig.reader",
    "write_design": "report",
    "write_diagnosis": "report",
    "write_reduction": "report",
    "write_run": "report",
}

__all__ = ["__version__", *_MODULE_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'etcfit' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"etcfit.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
