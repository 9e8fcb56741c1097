"""advice.json and plan.json, declared; the measurement folder that waits for the records, and what plays each test: a
CSV, a table for C, a sketch for Arduino and Teensy.
"""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import MeasurementError
from ..experiment.advice import Advice
from ..experiment.campaign import Campaign, LoggedColumn, PlannedTest, Winding, band, logger
from ..experiment.candidates import FULL, Played
from ..files import held, write_json
from ..rig.config import parse_config
from ..rig.user_text import c_comment, hash_comment
from .declared import Record, by_name, file_of, key, list_of, record_of

_POINTS = 300  # of an expected curve


class _Numbered(NamedTuple):
    campaign: Campaign
    number: int
    test: PlannedTest


def _stderr(symbols: tuple[str, ...], before: np.ndarray, after: np.ndarray) -> dict[str, Any]:
    return {s: {"now": b, "expected": a} for s, b, a in zip(symbols, before.tolist(), after.tolist(), strict=True)}


def _peaks(at: _Numbered) -> dict[str, Any]:
    ends = {name: [float(v.min()), float(v.max())] for name, v in at.test.forecast.shown.items()}
    return {**ends, "winding_degC": at.test.forecast.hottest(at.campaign.settings.ambient)}


def _expected(at: _Numbered) -> dict[str, Any]:
    time, shown = at.test.candidate.plan.time, at.test.forecast.shown
    seen = np.unique(np.linspace(0, time.size - 1, _POINTS).astype(int))
    bands = {name: band(at.test, at.campaign.setting, name) for name in shown}
    curves = {
        name: {"value": shown[name][0, seen], "low": low[seen], "high": high[seen]}
        for name, (low, high) in bands.items()
    }
    return {"time": time[seen], **curves}


LIMITS = Record(
    supply_V=key("number", "V.", "setting.supply"),
    current_A=key("number", "A.", "settings.current"),
    winding_degC=key("number", "degC.", "settings.temperature"),
    position_rad=key("[number]", "Between what the plate stays while it is driven about, rad.",
        lambda campaign: campaign.setting.kept_to(campaign.settings.margin), each={"description": "rad."}),
)  # fmt: skip
WINDING = record_of(Winding, called={"capacity": "capacity_J_per_K", "cooling": "cooling_s"})
STDERR = Record(
    now=key("number", "Before."),
    expected=key("number", "After."),
)  # fmt: skip
PLAY = Record(
    csv=key("text", "Time, voltage, duty.", lambda at: f"play/plan_{at.number}.csv"),
    table=key("text", "C99 header.", lambda at: f"play/plan_{at.number}/plan_{at.number}.h"),
    sketch=key("text", "For Arduino and Teensy.", lambda at: f"play/plan_{at.number}/plan_{at.number}.ino"),
    period_s=key("number", "Of a sample, which is held, s.",
        lambda at: float(at.test.candidate.played.time[1] - at.test.candidate.played.time[0])),
    supply_V=key("number", "Voltage of a duty of 1, V.", "test.candidate.played.supply"),
)  # fmt: skip
COLUMN = record_of(LoggedColumn)
TEST = Record(
    "One test.",
    file=key("text", "Where in `measurements/` its record goes.", "test.file"),
    test=key("text", "The rig test.", "test.candidate.plan.test"),
    shape=key("text", "Shape of the excitation; the rig test where it is one that was not made yet.",
        "test.candidate.kind"),
    how=key("text", "What is played, in words.", "test.candidate.plan.says"),
    remark=key("text?", "What was assumed of it.", lambda at: at.campaign.remark(at.test) or None),
    seconds=key("number", "Length of the log, s.", "test.candidate.seconds"),
    keeps_off_stops_s=key("[number]?", "Between which instants the plate keeps off the stops, s; null where it need "
        "not.", "test.candidate.window", each={"description": "s."}),
    play=key(PLAY, "The files that play it; null with open terminals.",
        lambda at: None if at.test.candidate.played is None else at, null=True),
    logger=key(list_of(COLUMN), "Columns of the record.", lambda at: logger(at.test, at.campaign)),
    peaks=key("object", "Least and largest of each channel over all models, SI; `winding_degC` is the hottest.",
        _peaks),
    pause_s=key("number", "For the winding to cool afterwards, s.", "test.pause"),
    expected=key("object", "Curves, SI: `time`, and for each channel `value`, `low` and `high` of the band in which "
        "it must stay.", _expected),
    stderr=key(by_name(STDERR), "Relative standard error of each parameter before and after this test.",
        lambda at: _stderr(at.campaign.symbols, at.test.before, at.test.after)),
)  # fmt: skip
LEFT_OUT = Record(
    "One.",
    how=key("text", "What would be played."),
    why=key("text", "Which limit."),
)  # fmt: skip
PLAN = file_of(
    "The next tests: written by `etcfit plan RUN|FOLDER --out PLAN`.",
    "rig.config",
    model=key("text", "By what it was planned.",
        lambda campaign: "fit" if campaign.at_fit else "graph readings", enum=["fit", "graph readings"]),
    cautions=key("[text]", "How far that fit can be believed.", each={"description": "A sentence."}),
    criterion=key("text", "What was to become small: sum (A) or geometric mean (D) of the relative variances.",
        "criterion.value", enum=["A", "D"]),
    limits=key(LIMITS, "What no test passes by any of the models.", ""),
    winding=key(WINDING, "Its heat."),
    stderr=key(by_name(STDERR), "Relative standard error of each free parameter now and after all tests.",
        lambda campaign: _stderr(campaign.symbols, campaign.now, campaign.expected)),
    seconds=key("number", "Length of all logs, s."),
    tests=key(list_of(TEST), "In the order in which they are made.",
        lambda campaign: [_Numbered(campaign, k, test) for k, test in enumerate(campaign.tests, 1)]),
    left_out=key(list_of(LEFT_OUT), "Candidates that would pass a limit.",
        lambda campaign: [{"how": how, "why": why} for how, why in campaign.left_out]),
    settings=key("object", "What it was planned by: every field of `etcfit.CampaignSettings`."),
)  # fmt: skip


def waiting_folder(campaign: Campaign) -> dict[str, str]:
    """Path inside PLAN -> text: rig.toml and, for each rig test, what to record; readable once a record is there."""
    files = {"measurements/rig.toml": rig_toml(campaign)}
    for test in campaign.tests:
        place = f"measurements/{test.candidate.plan.test}/README.txt"
        head = ",".join(column.header for column in logger(test, campaign))
        text = f"{test.file.rpartition('/')[2]}: {test.candidate.plan.says}. Header: {head}\n"
        files[place] = files.get(place, "") + text
    return files


def rig_toml(campaign: Campaign) -> str:
    """The rig's own rig.toml without its [holdout], whose files are not in this folder."""
    names = "".join(f"#   {test.file}\n" for test in campaign.tests)
    synthetic = "# SYNTHETIC: planned from simulated data\n" if campaign.rig.config.synthetic else ""
    head = (f"# Of the tests that `etcfit plan` chose. Record them, with the headers of each README.txt, as\n{names}"
            f"# and read them with `etcfit check` on this folder. To fit them with all that is there, copy them into\n"
            f"# {' '.join(campaign.rig.folder.split())}\n{synthetic}\n")  # fmt: skip
    own = campaign.rig.toml or _minimal(campaign)
    text = head + re.sub(r"(?ms)^\[holdout\].*?(?=^\[|\Z)", "", own)
    try:
        parse_config(text, "rig.toml")
    except MeasurementError:  # a [holdout] written otherwise
        text = head + _minimal(campaign)
    return text


def _minimal(campaign: Campaign) -> str:
    """Nameplate and sensor of a rig whose rig.toml is not at hand."""
    config, tps = campaign.rig.config, campaign.rig.config.tps
    low, high = (float(np.degrees(stop)) for stop in config.travel)
    sensor = "" if tps is None else (f"\n[tps]\nclosed_V = {tps.closed_V!r}\nopen_V = {tps.open_V!r}\n"
                                     f"travel_deg = {float(np.degrees(tps.travel))!r}\n")  # fmt: skip
    return (f"[rig]\nname = {json.dumps(config.name)}\nsynthetic = {str(config.synthetic).lower()}\n"
            f"gear_ratio = {config.gear_ratio!r}\nsupply_V = {campaign.setting.supply!r}\n"
            f"travel_deg = [{low!r}, {high!r}]\n{sensor}")  # fmt: skip


def play_files(campaign: Campaign) -> dict[str, str]:
    """Path inside PLAN -> text, for all tests in which something is played."""
    files: dict[str, str] = {}
    for number, test in enumerate(campaign.tests, 1):
        if test.candidate.played is None:
            continue
        plan, config = test.candidate.plan, campaign.rig.config
        synthetic = ["SYNTHETIC: planned from simulated data, not from a rig."] if config.synthetic else []
        about = [
            f"etcfit plan, test {number} of {len(campaign.tests)}: {plan.test}, {plan.says}.",
            f"Rig: {config.name}. Supply: {campaign.setting.supply:g} V.",
            f"Record it as measurements/{test.file}.",
            *synthetic,
        ]
        name = f"plan_{number}"
        files[f"play/{name}.csv"] = csv(test.candidate.played, about)
        files[f"play/{name}/{name}.h"] = c_table(test.candidate.played, name, about)
        files[f"play/{name}/{name}.ino"] = sketch(name, about)
    return files


def csv(played: Played, about: list[str]) -> str:
    """Time, terminal voltage and duty of each sample; held until the next."""
    rows = (f"{t:.6f},{v:.5f},{100.0 * c / FULL:.2f}\n"
            for t, v, c in zip(played.time, played.volts, played.counts, strict=True))  # fmt: skip
    return f"{hash_comment(about)}\ntime [s],voltage [V],duty [%]\n{''.join(rows)}"


def c_table(played: Played, name: str, about: list[str]) -> str:
    """A C99 header: duty in ten-thousandths of the supply, a sample each period."""
    upper = name.upper()
    period = round(1e6 * float(played.time[1] - played.time[0]))
    numbers = textwrap.fill(", ".join(str(c) for c in played.counts.tolist()), 110)
    return f"""\
{c_comment(about)}
#ifndef {upper}_H
#define {upper}_H

#include <stdint.h>

#define {upper}_COUNT {played.counts.size}UL
#define {upper}_PERIOD_US {period}UL
#define {upper}_FULL {FULL} /* a duty of 1 */
#define {upper}_SUPPLY_V {played.supply:.6g}

#if defined(__AVR__)
#include <avr/pgmspace.h>
#define {upper}_STORE PROGMEM
#define {upper}_AT(k) ((int16_t)pgm_read_word(&{name}_duty[k]))
#else
#define {upper}_STORE
#define {upper}_AT(k) ({name}_duty[k])
#endif

static const int16_t {name}_duty[{upper}_COUNT] {upper}_STORE = {{
{numbers}
}};

#endif
"""


def sketch(name: str, about: list[str]) -> str:
    """Plays the table once when `g` comes over the serial line; any other character stops it at once."""
    return _SKETCH.replace("@NAME@", name).replace("@UPPER@", name.upper()).replace("@ABOUT@", c_comment(about))


_SKETCH = """\
@ABOUT@

/* For an H-bridge with a PWM and a direction input. Check the pins. Sync is high while the test plays: let it
   trigger the logger. Send g to begin; any other character stops. */
#include "@NAME@.h"

static const uint8_t PWM_PIN = 9, DIRECTION_PIN = 8, SYNC_PIN = 7;
#if defined(TEENSYDUINO)
static const long PWM_FULL = 4095;
#else
static const long PWM_FULL = 255;
#endif

static void put(long duty) {
  digitalWrite(DIRECTION_PIN, duty < 0 ? HIGH : LOW);
  analogWrite(PWM_PIN, (int)(((duty < 0 ? -duty : duty) * PWM_FULL + @UPPER@_FULL / 2) / @UPPER@_FULL));
}

static void off() {
  put(0);
  digitalWrite(SYNC_PIN, LOW);
}

/* True if it was played to the end. */
static bool play() {
  digitalWrite(SYNC_PIN, HIGH);
  const uint32_t start = micros();
  for (uint32_t k = 0; k < @UPPER@_COUNT; k++) {
    while ((uint32_t)(micros() - start) < k * @UPPER@_PERIOD_US) {
      if (Serial.available()) return false;
    }
    put(@UPPER@_AT(k));
  }
  while ((uint32_t)(micros() - start) < @UPPER@_COUNT * @UPPER@_PERIOD_US) {
  }
  return true;
}

void setup() {
  pinMode(PWM_PIN, OUTPUT);
  pinMode(DIRECTION_PIN, OUTPUT);
  pinMode(SYNC_PIN, OUTPUT);
#if defined(TEENSYDUINO)
  analogWriteFrequency(PWM_PIN, 20000);
  analogWriteResolution(12);
#elif defined(__AVR_ATmega328P__)
  TCCR1B = (TCCR1B & 0xF8) | 1; /* 31 kHz on pins 9 and 10: the winding then sees the mean */
#endif
  off();
  Serial.begin(115200);
  Serial.println("@NAME@: g begins, anything else stops");
}

void loop() {
  if (!Serial.available() || Serial.read() != 'g') return;
  while (Serial.available()) Serial.read();
  const bool whole = play();
  off();
  Serial.println(whole ? "played" : "STOPPED");
  while (Serial.available()) Serial.read();
}
"""


def save_advice(run: Path, advice: Advice) -> None:
    """RUN/advice.json; it is of no stage, so it has no entry in RUN/run.json."""
    with held(run):
        write_json(run / "advice.json", "advice", ADVICE.json(advice))


def _by_symbol(advice: Advice, values: np.ndarray) -> dict[str, float]:
    return dict(zip(advice.symbols, values.tolist(), strict=True))


SEPARATES = Record(
    symbols=key("[text]", "The two."),
    correlation=key("number", "Of their estimates now.", "before"),
    correlation_after=key("number", "Of their estimates after it.", "after"),
)  # fmt: skip
OPTION = Record(
    "One more trace.",
    **Record(
        test=key("text", "The rig test."),
        again=key("flag", "It repeats a trace that was measured already."),
        how=key("text", "How it is made.", "says"),
        remark=key("text?", "What was assumed of it.", lambda option: option.remark or None),
        mean=key("number", "Geometric mean of `widths`."),
    ).within("option"),
    widths=key("{number}", "Width of each interval after it, as a share of what it is now."),
    separates=key(SEPARATES, "The pair of parameters that it separates best.", "option.separates", null=True),
)  # fmt: skip
ADVICE = file_of(
    "What one more trace of each rig test would tell: written by `etcfit check FOLDER --advise --out RUN`.",
    "rig.config",
    stderr_now=key("{number}", "Standard error of each free parameter with the traces that are there, relative: of a "
        "factor, where the parameter is positive.", lambda advice: _by_symbol(advice, advice.sd)),
    options=key(list_of(OPTION), "One more trace each, best first.",
        lambda advice: [{"option": each, "widths": _by_symbol(advice, each.shrinks)} for each in advice.options]),
    not_judged=key("{text}", "Rig tests that no trace can be simulated of, with the reason.",
        lambda advice: dict(advice.not_judged)),
    settings=key("object", "What the advice decided by: every field of `etcfit.AdviceSettings`."),
)  # fmt: skip
