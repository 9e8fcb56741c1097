"""drive.json, declared: every key, what it means and what of a study it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from ..car_log import Study
from ..car_log.coverage import Lack
from ..car_log.criteria import Word
from ..files import plain
from ..rig.base import RigConfig
from .declared import Record, key, list_of
from .shared import RIG, SYNTHETIC

WORDS = list(get_args(Word))
GAIN_SETS = ["present", "half_way", "proposed"]  # of `etcfit tune`


def drive_json(
    config: RigConfig, studies: Sequence[Study], lacks: Sequence[Lack], beside: Any = None
) -> dict[str, Any]:
    """The object of drive.json; what is infinite becomes null, as a settling that never comes.

    Args:
        config: of the rig.
        studies: a log each.
        lacks: what to record next.
        beside: the log beside what was foretold for it, see `reporting.car_log.foretold.Held`; None where nobody asked.
    """
    found = {"config": config, "logs": studies, "record_next": lacks, "foretold": beside}
    return plain(DRIVE.written(found))


USAGE = Record(
    edges=key("[number]", "Of the bins, % of travel."),
    shares=key("[number]", "Of the time in each bin, sum 1."),
    bounds=key("[number]", "Two positions, %."),
    between=key("number", "Share of the time between them."),
    shortest=key("[number]", "Shortest interval that holds 77 % of the time, %."),
)  # fmt: skip
SPECTRUM = Record(
    frequency=key("[number]", "Hz."),
    amplitude=key("[number?]", "% rms in a band of one bin."),
    dominant=key("number?", "Hz, the highest peak at or above 0.25 Hz."),
    half=key("number?", "Hz, below which half of the power lies."),
)  # fmt: skip
RANGE = Record(
    "One part.",
    low=key("number", "Setpoint from, %."),
    high=key("number", "Setpoint to, %."),
    seconds=key("number", "In it."),
    rmse=key("number", "% of travel."),
    mean=key("number", "Of position - setpoint, % of travel."),
)  # fmt: skip
TRACKING = Record(
    rmse=key("number?", "Eq. 9, % of travel."),
    stderr=key("number?", "Of it, from blocks of 5 s."),
    lag=key("number?", "Behind the setpoint, s."),
    lag_stderr=key("number?", "Of it, from blocks of 5 s.", optional=True),
    left=key("number?", "RMSE with the lag taken out."),
    demand=key("number?", "rms rate of the setpoint, %/s."),
    astray=key("number", "Longest time off by more than 10 % of travel, s.", optional=True),
    within_reach=key("number", "RMSE of a loop on this setpoint that settles in 0.2 s, % of travel.", optional=True),
    ranges=key(list_of(RANGE), "The error by parts of the travel.", optional=True),
)  # fmt: skip
STEP = Record(
    "One step and its answer.",
    begin=key("number", "s."),
    before=key("number", "Setpoint, %."),
    after=key("number", "Setpoint, %."),
    held=key("number", "How long it then rests, s."),
    overshoot=key("number", "% of the step, or of 1 % of the travel where that is more."),
    settling=key("number?", "s; null: it does not settle within `held`."),
    lag=key("number?", "s until half of the way is made; null: never."),
    error=key("number", "Mean of position - setpoint in the last quarter of the rest, % of travel."),
    rms=key("number", "Of the error over the rest, % of travel."),
    band=key("number", "Within which it has settled, % of travel."),
)  # fmt: skip
CYCLE = Record(
    amplitude=key("number", "Half of what the plate moves to and fro, % of travel."),
    period=key("number", "s."),
    share=key("number", "Of the time at rest in which there is one, 0 to 1."),
    kind=key("text", "Why.", enum=["stick-slip", "instability", "unknown"]),
    still=key("number", "Share of the period in which the plate is nearly still; 0.16 for a sine."),
    where=key("[number]", "Least and largest setpoint with one, %."),
    duty=key("number?", "Half of what the duty moves to and fro, %."),
    dead_zone=key("number?", "|error| below which the integral must stand still to stop stick-slip, % of travel."),
    dither=key("number?", "Amplitude of a quick alternating duty that would stop stick-slip, %."),
)  # fmt: skip
DUTY = Record(
    lowest=key("number", "%."),
    highest=key("number", "%."),
    activity=key("number?", "Standard deviation at rest, %."),
    jitter=key("number?", "From sample to sample at rest, standard deviation over sqrt 2, %."),
    limit=key("number?", "|duty| at which it stands again and again, %; null: none seen."),
    saturated=key("number", "Share of the time at the limit, 0 to 1."),
    saturated_at_rest=key("number?", "Share of the time at rest, 0 to 1."),
    longest=key("number", "s at the limit without a break."),
)  # fmt: skip
ENDS = Record(
    closed=key("number", "Plate closed."),
    opened=key("number", "Plate open."),
)  # fmt: skip
SETTING = Record(
    "One setting.",
    ecu=key("text", "For which."),
    name=key("text", "As it calls it."),
    value=key("number", "In `unit`."),
    unit=key("text", "Of it."),
)  # fmt: skip
SENSORS = Record(
    unit=key("text", "Of the ends.", enum=["V", "%"]),
    first=key(ENDS, "Ends of the first."),
    second=key(ENDS, "Ends of the second."),
    stops=key("number", "Where the second is at its end, % of travel; 100: it goes all the way."),
    late=key("number", "Where the second begins to move, % of travel."),
    crossed=key("text", "Why both seem to be exchanged; empty where they do not."),
    dwelt=key("[flag]", "Whether the plate rests closed, and open."),
    apart=key("number", "Largest difference that lasts 0.1 s, % of travel."),
    apart_rms=key("number", "Root mean square of the difference, % of travel."),
    findings=key("[text]", "What is to be known of the pair."),
    table=key(list_of(SETTING), "What to type into ECUs; empty where the log holds per cent."),
)  # fmt: skip
JUDGEMENT = Record(
    "One.",
    name=key("text", "What is judged."),
    value=key("number?", "In `unit`; null: not known, or without end (`word` tells)."),
    limit=key("number", "Threshold."),
    unit=key("text", "Of both."),
    word=key("text", "How it is.", enum=WORDS),
    where=key("text", "Where the value was found, or why there is none."),
    source=key("text", "Of the threshold."),
    at_least=key("flag", "The value must not be below the limit."),
)  # fmt: skip
VERDICT = Record(
    word=key("text", "In a word.", enum=WORDS),
    says=key("text", "In sentences."),
    judgements=key(list_of(JUDGEMENT), "A threshold each."),
)  # fmt: skip
LOG = Record(
    "One log.",
    file=key("text", "Its name.", "log.name"),
    seconds=key("number", "Its length.", lambda study: np.ptp(study.log.position.time)),
    columns=key("{text}", "Header in the file of each quantity that was taken.", "log.columns", optional=True),
    usage=key(USAGE, "Where the plate spends its time."),
    spectrum=key(SPECTRUM, "How fast it is moved; null of a log that is too short.", null=True),
    tracking=key(TRACKING, "How closely it follows; null without a setpoint.", null=True),
    steps=key(list_of(STEP), "Every step of the setpoint, in the order of time.", optional=True),
    cycle=key(CYCLE, "Oscillation while the setpoint rests; null where there is none.", null=True, optional=True),
    duty=key(DUTY, "What the duty does; null where none was logged.", null=True, optional=True),
    cycle_says=key("text", "The same in sentences; empty where there is none.",
        lambda study: "" if study.cycle is None else study.cycle.says, optional=True),
    sensors=key(SENSORS, "Both sensors of the plate; null where one was not logged.", null=True, optional=True),
    verdict=key(VERDICT, "Whether the loop is good enough.", optional=True),
)  # fmt: skip
LACK = Record(
    "One kind of moves.",
    name=key("text", "In words."),
    found=key("number", "How much of it there is."),
    needed=key("number", "How much is needed."),
    unit=key("text", "Of both."),
    record=key("text", "What to do."),
    why=key("text", "What it tells."),
)  # fmt: skip
FORETOLD_FIGURE = Record(
    "One figure.",
    name=key("text", "Of it."),
    unit=key("text", "Of its numbers."),
    low=key("number?", "Foretold, 2.5 % of the models that fit; null: never."),
    high=key("number?", "Foretold, 97.5 %; null: never."),
    least=key("number?", "Least that is as foretold; null: no such limit."),
    most=key("number?", "Most that is as foretold; null: no such limit."),
    found=key("number?", "In the log, the median of each way, the worse way; null: never."),
    as_foretold=key("flag", "Whether it is."),
)  # fmt: skip
FORETOLD = Record(
    run=key("text", "Run folder of `etcfit tune`.", lambda beside: str(beside.run)),
    made_with=key("text", "Whose gains made the log.", enum=GAIN_SETS),
    as_foretold=key("flag", "Whether every figure is as foretold, and tracking no worse than with the gains before.",
        "found.as_foretold"),
    says=key("text", "The same in words."),
    steps=key("whole", "How many steps of the log count.", "found.steps"),
    better=key("flag?", "Whether the error is less than with the gains before; null where nobody knows that.",
        "found.better"),
    figures=key(list_of(FORETOLD_FIGURE), "Overshoot, settling, error.", "found.figures"),
)  # fmt: skip
DRIVE = Record(
    "Logs from the car: written by `etcfit drive --out RUN`.",
    rig=RIG.taken_from("config.name"),
    synthetic=SYNTHETIC.taken_from("config.synthetic"),
    logs=key(list_of(LOG), "One for each log, in the order studied."),
    record_next=key(list_of(LACK), "What these logs lack for gains to be told from them, what wins most first.",
        optional=True),
    foretold=key(FORETOLD, "The log beside what `etcfit tune` foretold; there with --foretold.", optional=True),
)  # fmt: skip
