"""The public names of the package and their modules: `__init__.py` imports each when it is first used."""

from .api.controller import Designed as Designed
from .api.controller import Reduced as Reduced
from .api.explanation import Diagnosed as Diagnosed
from .api.explanation import Sampled as Sampled
from .api.fit import Fit as Fit
from .api.fleet import Fleet as Fleet
from .api.measurements import Advised as Advised
from .api.measurements import Checked as Checked
from .api.measurements import Driven as Driven
from .api.measurements import Planned as Planned
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
from .api.views import FittedTrace as FittedTrace
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
from .fleets.settings import FleetSettings as FleetSettings
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

__version__: str
IMPORTED_AT: float
MODULE_OF: dict[str, str]
__all__: list[str]
