"""advice.json, plan.json, the measurement folder that waits for the records, and what plays each test: a CSV, a
table for C, a sketch for Arduino and Teensy.
"""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MeasurementError
from ..experiment.advice import Advice, Option
from ..experiment.campaign import Campaign, LoggedColumn, PlannedTest, band, logger
from ..experiment.candidates import FULL, Played
from ..files import held, plain, write_json
from ..rig.config import parse_config
from ..rig.user_text import c_comment, hash_comment
from .fit import versions

_POINTS = 300  # of an expected curve


def plan_json(campaign: Campaign) -> dict[str, Any]:
    """The object of plan.json, see docs/formats.md."""
    s, settings = campaign.setting, campaign.settings
    return plain({
        "rig": campaign.rig.config.name,
        "synthetic": campaign.rig.config.synthetic,
        "model": "fit" if campaign.at_fit else "graph readings",
        "cautions": campaign.cautions,
        "criterion": campaign.criterion.value,
        "limits": {
            "supply_V": s.supply,
            "current_A": settings.current,
            "winding_degC": settings.temperature,
            "position_rad": _room(campaign),
        },
        "winding": {"capacity_J_per_K": campaign.winding.capacity, "cooling_s": campaign.winding.cooling,
                    "fitted": campaign.winding.fitted},
        "stderr": _stderr(campaign.symbols, campaign.now, campaign.expected),
        "seconds": campaign.seconds,
        "tests": [_test(campaign, k, test) for k, test in enumerate(campaign.tests, 1)],
        "left_out": [{"how": how, "why": why} for how, why in campaign.left_out],
        "settings": settings,
        "versions": versions(),
    })  # fmt: skip


def _room(campaign: Campaign) -> list[float]:
    margin = campaign.settings.margin * (campaign.setting.open - campaign.setting.rest)
    return [campaign.setting.rest + margin, campaign.setting.open - margin]


def _stderr(symbols: tuple[str, ...], before: np.ndarray, after: np.ndarray) -> dict[str, Any]:
    return {s: {"now": b, "expected": a} for s, b, a in zip(symbols, before.tolist(), after.tolist(), strict=True)}


def _test(campaign: Campaign, number: int, test: PlannedTest) -> dict[str, Any]:
    plan, played = test.candidate.plan, test.candidate.played
    seen = np.unique(np.linspace(0, plan.time.size - 1, _POINTS).astype(int))
    hot = campaign.settings.ambient + float(test.forecast.warmth.max())
    bands = {name: band(test, campaign.setting, name) for name in test.forecast.shown}
    expected = {
        name: {"value": test.forecast.shown[name][0, seen], "low": low[seen], "high": high[seen]}
        for name, (low, high) in bands.items()
    }
    return {
        "file": test.file,
        "test": plan.test,
        "shape": test.candidate.kind,
        "how": plan.says,
        "remark": campaign.remark(test) or None,
        "seconds": test.candidate.seconds,
        "keeps_off_stops_s": test.candidate.window,
        "play": None if played is None else {
            "csv": f"play/plan_{number}.csv",
            "table": f"play/plan_{number}/plan_{number}.h",
            "sketch": f"play/plan_{number}/plan_{number}.ino",
            "period_s": float(played.time[1] - played.time[0]),
            "supply_V": played.supply,
        },
        "logger": [_column(column) for column in logger(test, campaign)],
        "peaks": {name: [float(v.min()), float(v.max())] for name, v in test.forecast.shown.items()}
        | {"winding_degC": hot},
        "pause_s": test.pause,
        "expected": {"time": plan.time[seen], **expected},
        "stderr": _stderr(campaign.symbols, test.before, test.after),
    }  # fmt: skip


def _column(column: LoggedColumn) -> dict[str, Any]:
    return {"header": column.header, "low": column.low, "high": column.high, "resolution": column.resolution}


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
        about = _about(campaign, test, number)
        name = f"plan_{number}"
        files[f"play/{name}.csv"] = csv(test.candidate.played, about)
        files[f"play/{name}/{name}.h"] = c_table(test.candidate.played, name, about)
        files[f"play/{name}/{name}.ino"] = sketch(name, about)
    return files


def _about(campaign: Campaign, test: PlannedTest, number: int) -> list[str]:
    synthetic = ["SYNTHETIC: planned from simulated data, not from a rig."] if campaign.rig.config.synthetic else []
    return [
        f"etcfit plan, test {number} of {len(campaign.tests)}: {test.candidate.plan.test}, {test.candidate.plan.says}.",
        f"Rig: {campaign.rig.config.name}. Supply: {campaign.setting.supply:g} V.",
        f"Record it as measurements/{test.file}.",
        *synthetic,
    ]


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
        write_json(run / "advice.json", "advice", advice_json(advice))


def advice_json(advice: Advice) -> dict[str, Any]:
    """The object of advice.json, see docs/formats.md."""
    return plain({
        "rig": advice.rig.config.name,
        "synthetic": advice.rig.config.synthetic,
        "stderr_now": dict(zip(advice.symbols, advice.sd.tolist(), strict=True)),
        "options": [_option(option, advice.symbols) for option in advice.options],
        "not_judged": dict(advice.not_judged),
        "settings": advice.settings,
        "versions": versions(),
    })  # fmt: skip


def _option(option: Option, symbols: tuple[str, ...]) -> dict[str, Any]:
    pair = option.separates
    return {
        "test": option.test,
        "again": option.again,
        "how": option.says,
        "remark": option.remark or None,
        "mean": option.mean,
        "widths": dict(zip(symbols, option.shrinks.tolist(), strict=True)),
        "separates": pair and {"symbols": pair.symbols, "correlation": pair.before, "correlation_after": pair.after},
    }
