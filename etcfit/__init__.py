"""Parameters, missing physics and PID gains of an electronic throttle body, from a folder of rig measurements.

    rig = etcfit.read_folder("measurements/bench_twin")
    fit = etcfit.fit(rig)                   fit.parameters, fit.trace(file).to_frame(), fit.plot.overview()
    found = etcfit.diagnose(fit)            found.verdict, found.ledger, found.final
    etcfit.sample(found), etcfit.reduce(found), etcfit.design(found)
    found.save("runs/x");  etcfit.load("runs/x");  etcfit.report("runs/x")

The verbs are those of the command line, one to one. Names are imported when they are first used, so that `import
etcfit` costs nothing and `etcfit --help` answers at once.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

# the model is stiff and the fit compares nested models: 32 bit is not enough. Read by JAX when it is first imported
os.environ.setdefault("JAX_ENABLE_X64", "1")
# XLA's log, such as its alarm about a slow compilation, is not for the terminal; what fails still is an exception
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

if TYPE_CHECKING:
    from .api.advised import Advised as Advised
    from .api.checked import Checked as Checked
    from .api.designed import Designed as Designed
    from .api.diagnosed import Diagnosed as Diagnosed
    from .api.driven import Driven as Driven
    from .api.fit import Fit as Fit
    from .api.fleet import Fleet as Fleet
    from .api.planned import Planned as Planned
    from .api.reduced import Reduced as Reduced
    from .api.sampled import Sampled as Sampled
    from .api.trace import FittedTrace as FittedTrace
    from .api.tuned import Tuned as Tuned
    from .api.verbs import advise as advise
    from .api.verbs import check as check
    from .api.verbs import design as design
    from .api.verbs import diagnose as diagnose
    from .api.verbs import drive as drive
    from .api.verbs import export as export
    from .api.verbs import fetch as fetch
    from .api.verbs import fit as fit
    from .api.verbs import fleet as fleet
    from .api.verbs import load as load
    from .api.verbs import plan as plan
    from .api.verbs import reduce as reduce
    from .api.verbs import report as report
    from .api.verbs import sample as sample
    from .api.verbs import tune as tune
    from .control.design import Design as Design
    from .control.pid import RULES as RULES
    from .control.pid import Gains as Gains
    from .control.pid import Requirements as Requirements
    from .control.settings import DesignSettings as DesignSettings
    from .control.settings import FleetDesignSettings as FleetDesignSettings
    from .control.settings import FrequencySettings as FrequencySettings
    from .datasets import DATASETS as DATASETS
    from .datasets import Dataset as Dataset
    from .diagnosis import Diagnosis as Diagnosis
    from .diagnosis.settings import DiagnosisSettings as DiagnosisSettings
    from .errors import MeasurementError as MeasurementError
    from .errors import UsageError as UsageError
    from .estimation.fitted_model import Fitted as Fitted
    from .estimation.joint_fit import FitResult as FitResult
    from .estimation.settings import FitSettings as FitSettings
    from .experiment.settings import AdviceSettings as AdviceSettings
    from .experiment.settings import CampaignSettings as CampaignSettings
    from .experiment.settings import CheckSettings as CheckSettings
    from .exporting.base import ExportSettings as ExportSettings
    from .fleets.statistics.settings import FleetSettings as FleetSettings
    from .importing.tuning import TuneSettings as TuneSettings
    from .model.ecus import ECUS as ECUS
    from .model.effects import EFFECTS as EFFECTS
    from .model.effects import AbstractEffect as AbstractEffect
    from .model.effects import Contribution as Contribution
    from .model.linear import TransferFunction as TransferFunction
    from .model.parameters import Parameter as Parameter
    from .model.parameters import parameter as parameter
    from .posterior.settings import SamplingSettings as SamplingSettings
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
    from .stages import run as run

MODULE_OF = {
    "FitSettings": "estimation.settings",
    "DiagnosisSettings": "diagnosis.settings",
    "SamplingSettings": "posterior.settings",
    "DesignSettings": "control.settings",
    "FrequencySettings": "control.settings",
    "AdviceSettings": "experiment.settings",
    "CampaignSettings": "experiment.settings",
    "CheckSettings": "experiment.settings",
    "ExportSettings": "exporting.base",
    "TuneSettings": "importing.tuning",
    "FleetSettings": "fleets.statistics.settings",
    "FleetDesignSettings": "control.settings",
    "EFFECTS": "model.effects",
    "TESTS": "rig",
    "DATASETS": "datasets",
    "ECUS": "model.ecus",
    "RULES": "control.pid",
    "advise": "api.verbs",
    "check": "api.verbs",
    "design": "api.verbs",
    "diagnose": "api.verbs",
    "drive": "api.verbs",
    "export": "api.verbs",
    "fetch": "api.verbs",
    "fit": "api.verbs",
    "fleet": "api.verbs",
    "load": "api.verbs",
    "plan": "api.verbs",
    "reduce": "api.verbs",
    "report": "api.verbs",
    "run": "stages",
    "sample": "api.verbs",
    "tune": "api.verbs",
    "Advised": "api.advised",
    "Checked": "api.checked",
    "Designed": "api.designed",
    "Diagnosed": "api.diagnosed",
    "Driven": "api.driven",
    "Fit": "api.fit",
    "Fleet": "api.fleet",
    "FittedTrace": "api.trace",
    "Planned": "api.planned",
    "Reduced": "api.reduced",
    "Sampled": "api.sampled",
    "Tuned": "api.tuned",
    "AbstractEffect": "model.effects",
    "AbstractRigTest": "rig.base",
    "Boundary": "rig.base",
    "Channel": "rig.base",
    "Contribution": "model.effects",
    "Dataset": "datasets",
    "Design": "control.design",
    "Diagnosis": "diagnosis",
    "FitResult": "estimation.joint_fit",
    "Fitted": "estimation.fitted_model",
    "Fixed": "rig.base",
    "Gains": "control.pid",
    "Measurement": "rig.base",
    "MeasurementError": "errors",
    "Parameter": "model.parameters",
    "Prior": "rig.base",
    "Reading": "rig.base",
    "Requirements": "control.pid",
    "Rig": "rig.base",
    "RigConfig": "rig.base",
    "Start": "rig.base",
    "Tied": "rig.base",
    "TransferFunction": "model.linear",
    "UsageError": "errors",
    "parameter": "model.parameters",
    "read_folder": "rig.reader",
}

__all__ = ["__version__", *MODULE_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in MODULE_OF:
        raise AttributeError(f"module 'etcfit' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"etcfit.{MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
