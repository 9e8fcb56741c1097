"""tune.json, declared: every key, what it means and what of logs of a car it is."""

from __future__ import annotations

from ..car_log import Lack
from ..control.borne import Borne
from ..control.pid.conditions import LARGE_HOLD
from ..importing.tuning import LogCheck
from .declared import FIT_STATE, Record, effects_of, key, list_of, record_of
from .drive import GAIN_SETS


def _each(kind: str) -> Record:
    """P, I and D."""
    return Record(**{name: key(kind, f"{name}.") for name in "PID"})


SAYS = Record(
    answer=key("text", "The gains to try first, or why there are none."),
    model=key("[text]", "How good the model is.", each={"description": "A sentence."}),
    requirements=key("text?", "Which requirements the proposed gains miss, what that means, and what decides; null "
        "where there are no gains."),
    next=key("[text]", "What to do with the gains, and what the next log should show.",
        each={"description": "A sentence."}),
)  # fmt: skip
MODEL = Record(
    input=key("text", "What drives the model: the logged duty, or the ECU with the gains that are in it now.",
        "input.model", enum=["duty", "ecu"]),
    why=key("text", "Why so.", "input.why"),
    effects=key("[text]?", "Effects of the final model; null where the logs stop it before.",
        lambda found: found.result and effects_of(found.result), each={"description": "Name."}),
)  # fmt: skip
CHECK = record_of(LogCheck)
HELD_OUT = Record(
    file=key("text?", "The part that was not fitted.", lambda found: found.input.held_out or None),
    rms_pct=key("number?", "Error on it, % of the travel.", "held_out_error"),
    explained=key("number?", "Share of its motion that is explained, at most 1.", lambda found: found.explained[0]),
    explained_fitted=key("number?", "The same of the fitted part.", lambda found: found.explained[1]),
)  # fmt: skip
BORNE = record_of(
    Borne,
    null=("missed", "hertz"),
    without=("rows",),
    worst=key("number?", "|Delta T|, stable below 1, required is 0.5; null where the log has no motion there."),
)
LARGE_STEPS = Record(
    low_pct=key("number", "Lower level, % of the travel.", "low", scale=100.0),
    high_pct=key("number", "Upper level, % of the travel.", "high", scale=100.0),
    hold_s=key("number", "For how long each is held, s.", lambda _: LARGE_HOLD),
)  # fmt: skip
STEP = Record(
    "One set of gains on the fitted model.",
    name=key("text", "Which.", "step.name", enum=GAIN_SETS),
    gains=key(_each("number"), "As the ECU writes them; null where they are withheld.", null=True),
    factors=key(_each("number?"), "Over the present gains; null where these are not known or gains are withheld.",
        null=True),
    overshoot_pct=key("[number?]", "Of steps of 10 to 70 % of the travel and back: 2.5, 50 and 97.5 % of the models "
        "that fit.", "step.overshoot", each={"description": "%; null: without end."}),
    settling_s=key("[number?]", "The same; null where it does not settle.", "step.settling",
        each={"description": "s."}),
    error_pct=key("[number?]", "The same of the error of these steps: rms of target - position over the 0.5 s after "
        "each.", "step.error", each={"description": "% of the travel."}),
    rmse_pct=key("number?", "Tracking error of the nominal model, % of the travel.", "step.figures.rmse_pct"),
    gain_margin_db=key("number?", "Of the linear loop.", "step.figures.gain_margin_db"),
    phase_margin_deg=key("number?", "Of the linear loop.", "step.figures.phase_margin_deg"),
    probability_met=key("number?", "Share of the models that fit which meet every requirement.",
        "believed.probability_met"),
    probability_stable=key("number?", "Share of them whose linear loop is stable.", "believed.probability_stable"),
    probability_better=key("number?", "Share of them on which these gains track better than the present ones.",
        "believed.better"),
)  # fmt: skip
TUNE = Record(
    "From logs of a car to gains: written by `etcfit tune`.",
    verdict=key("text", "Whether there are gains to type in.",
        lambda at: "not from this log" if at["found"].why_not else "gains", enum=["gains", "not from this log"]),
    why_not=key("text?", "Why there are none.", lambda at: at["found"].why_not or None),
    doubts=key("[text]", "Why gains would be withheld without `--anyway`, a sentence each.", "found.doubts",
        each={"description": "One."}),
    says=key(SAYS, "What terminal and page say in words."),
    ecu=key("text", "Name of the make of ECU.", "found.profile.name"),
    model=key(MODEL, "What the gains come from.", "found"),
    checks=key(list_of(CHECK), "What a log must have.", "found.input.checks"),
    fit=key(FIT_STATE, "State of the fit behind it.", "found.result.state", null=True),
    held_out=key(HELD_OUT, "How well the model predicts, free running.", "found"),
    borne=key(list_of(BORNE), "What the loop of each new step bears of what the model misses, half way first; empty "
        "where the logs stop it before.", "found.borne"),
    supply_V=key("number", "Of the ECU's output, V.", "found.input.supply"),
    present=key(_each("number"), "Gains that are in the ECU now, as it writes them; null where not given.",
        lambda at: at["found"].request.gains and dict(zip("PID", at["found"].request.gains, strict=True)), null=True),
    unit=key(_each("text"), "Unit of each gain."),
    large_steps=key(LARGE_STEPS, "The steps of which overshoot, settling and error of each set of gains are foretold, "
        "up and back; null where the logs stop it.", "found.design.settings.scenarios", null=True),
    steps=key(list_of(STEP), "From the present gains to the proposed ones; the latter alone where nobody said the "
        "former; none where the logs stop it."),
    options=key("[text]", "Options of `etcfit tune` that another log of this car is given too: make of ECU, its "
        "times, supply, columns; without present gains and run folder.",
        lambda at: at["found"].request.options(), each={"description": "A word."}),
    record_next=key(list_of(record_of(Lack)), "What to record next, what wins most first.", "found.lacks"),
    pid=key("text?", "SHA-256 of the pid.json that it goes with; null where there is none."),
)  # fmt: skip
