"""What plays a planned test: a CSV, a table for C, and a sketch for Arduino and Teensy that plays the table."""

from __future__ import annotations

import textwrap

from ..experiment.campaign import Campaign, PlannedTest
from ..experiment.candidates import FULL, Played
from ..rig.user_text import c_comment, hash_comment


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
