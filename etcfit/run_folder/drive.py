"""drive.json, declared: every key, what it means and what of a study it is."""

from __future__ import annotations

from typing import get_args

import numpy as np

from ..car_log.coverage import Lack
from ..car_log.criteria import Judgement, Word
from ..car_log.duty import DutyUse
from ..car_log.foretold import Figure
from ..car_log.limit_cycle import LimitCycle
from ..car_log.sensors import Sensors, Setting
from ..car_log.steps import Step
from ..car_log.tracking import Tracking
from ..car_log.usage import Spectrum, Usage
from .declared import RIG, SYNTHETIC, Record, key, list_of, record_of

WORDS = list(get_args(Word))
GAIN_SETS = ["present", "half_way", "proposed"]  # of `etcfit tune`


TRACKING = record_of(Tracking, null=("rmse", "demand"), optional=("lag_stderr", "astray", "within_reach", "ranges"))
SENSORS = record_of(
    Sensors,
    findings=key("[text]", "What is to be known of the pair."),
    table=key(list_of(record_of(Setting)), "What to type into ECUs; empty where the log holds per cent."),
)  # fmt: skip
VERDICT = Record(
    word=key("text", "In a word.", enum=WORDS),
    says=key("text", "In sentences."),
    judgements=key(list_of(record_of(Judgement)), "A threshold each."),
)  # fmt: skip
LOG = Record(
    "One log.",
    file=key("text", "Its name.", "log.name"),
    seconds=key("number", "Its length.", lambda study: np.ptp(study.log.position.time)),
    columns=key("{text}", "Header in the file of each quantity that was taken.", "log.columns", optional=True),
    usage=key(record_of(Usage), "Where the plate spends its time."),
    spectrum=key(record_of(Spectrum, null=("amplitude", "dominant", "half")),
        "How fast it is moved; null of a log that is too short.", null=True),
    tracking=key(TRACKING, "How closely it follows; null without a setpoint.", null=True),
    steps=key(list_of(record_of(Step, null=("settling",))), "Every step of the setpoint, in the order of time.",
        optional=True),
    cycle=key(record_of(LimitCycle), "Oscillation while the setpoint rests; null where there is none.", null=True,
        optional=True),
    duty=key(record_of(DutyUse), "What the duty does; null where none was logged.", null=True, optional=True),
    cycle_says=key("text", "The same in sentences; empty where there is none.",
        lambda study: "" if study.cycle is None else study.cycle.says, optional=True),
    sensors=key(SENSORS, "Both sensors of the plate; null where one was not logged.", null=True, optional=True),
    verdict=key(VERDICT, "Whether the loop is good enough.", optional=True),
)  # fmt: skip
FORETOLD_FIGURE = record_of(
    Figure,
    null=("low", "high", "least", "most", "found"),
    as_foretold=key("flag", "Whether it is."),
)  # fmt: skip
FORETOLD = Record(
    run=key("text", "Run folder of `etcfit tune`.", lambda beside: str(beside.run)),
    made_with=key("text", "Whose gains made the log.", enum=GAIN_SETS),
    as_foretold=key("flag", "Whether every figure is as foretold, and tracking no worse than with the gains before.",
        "found.as_foretold"),
    says=key("text", "The same in words."),
    steps=key("whole", "How many steps of the log count.", "found.steps"),
    better=key("flag?", "Whether the error is less than with the gains before; null where unknown.",
        "found.better"),
    figures=key(list_of(FORETOLD_FIGURE), "Overshoot, settling, error.", "found.figures"),
)  # fmt: skip
DRIVE = Record(
    "Logs from the car: written by `etcfit drive --out RUN`.",
    rig=RIG.taken_from("config.name"),
    synthetic=SYNTHETIC.taken_from("config.synthetic"),
    logs=key(list_of(LOG), "One for each log, in the order studied."),
    record_next=key(list_of(record_of(Lack)), 
        "What these logs lack to determine gains, the most useful first.", optional=True),
    foretold=key(FORETOLD, "The log compared with the prediction of `etcfit tune`; present with --foretold.",
        optional=True),
)  # fmt: skip
