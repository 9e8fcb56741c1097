"""The three closing lines of every command: the answer in words, files to look at, and the next command.

This module has those of commands without a model: check, import, plan, and logs from the car.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import command
from ..numbers import counted

if TYPE_CHECKING:
    from ...car_log import Study
    from ...car_log.coverage import Lack
    from ...experiment.advice import Advice
    from ...experiment.campaign import Campaign
    from ...experiment.check import CheckResult
    from ...importing import Imported


NEXT_LOG = "NEXT_LOG"  # placeholder in a command for a file that is not recorded yet
_NAMED = 2  # number of names in a line before it only counts the others


@dataclass(frozen=True)
class Closing:
    """The closing lines of a command."""

    answer: str  # the result in plain words
    next: str  # the next command with its arguments, or a sentence on what to do
    look: tuple[Path, ...] = ()  # files to open, the most informative first; missing files are left out

    def __str__(self) -> str:
        there = " and ".join(shlex.quote(str(path)) for path in self.look if path.exists())
        return "\n".join((f"Answer: {self.answer}", *([f"Look:   {there}"] if there else []), f"Next:   {self.next}"))


def mended(line: str, folder: str | Path, then: str) -> str:
    """A command, with what to change before it is typed."""
    return f"{then}, after this change in {shlex.quote(str(Path(folder) / 'rig.toml'))}: {line}"


def first_few(names: Sequence[str]) -> str:
    """The first names, and the number of further ones: "R_a, K_b and 9 more"."""
    from ...estimation.identifiability import listed

    more = len(names) - _NAMED
    return f"{', '.join(names[:_NAMED])} and {more} more" if more > 1 else listed(names)


_TOML = "rig.toml"


def of_new(folder: Path) -> Closing:
    """Closing lines for a folder to fill in."""
    answer = "A rig.toml with every key explained, and a folder for each rig test that says what to record."
    further = command("import", "RECORDING", "--to", "FOLDER", "--rig", folder / _TOML)
    return Closing(answer, f"{further}, once you have filled in each ... of that file", (folder / _TOML,))


def of_imported(done: Imported) -> Closing:
    """Closing lines of an import."""
    tests = len({file.partition("/")[0] for file, _, _ in done.traces})
    warned = f", with {counted(len(done.warnings), 'warning')}" if done.warnings else ""
    answer = f"{counted(len(done.traces), 'trace')} of {counted(tests, 'rig test')}{warned}: check units and signs."
    return Closing(answer, command("check", done.folder), (done.folder / _TOML,))


def of_fetched(name: str, folder: Path) -> Closing:
    """Closing lines for a public data set."""
    return Closing(f"{name} is a measurement folder now; its README says what was converted and assumed.",
                   command("check", folder), (folder / "README.md",))  # fmt: skip


def of_check(result: CheckResult, folder: Path) -> Closing:
    """What the traces of a folder determine, or what is wrong with the rig."""
    from ...rig.base import ALLOWED_FOR

    verdict = result.identifiability
    assert verdict is not None, "a folder that can be fitted"
    fit = command("fit", folder, "--out", Path("runs") / folder.resolve().name)
    mistakes = [each for each in result.rig.findings if each.kind not in ALLOWED_FOR]
    lost = f"; they cannot tell {first_few(verdict.lost)}" if verdict.lost else ""
    sentence = f"{counted(len(result.traces), 'trace')} can tell the parameters of Eqs. 1-2{lost}."
    if mistakes:
        found = f"The records show {counted(len(mistakes), 'mistake')} of the rig: {mistakes[0].found} {sentence}"
        return Closing(found, mended(mistakes[0].mend, folder, command("check", folder)))
    return Closing(sentence, fit)


def of_advice(advice: Advice, folder: Path, at: Path | None, written: Path | None) -> Closing:
    """The most useful further trace; folder and run `at` as the user typed them, `written` is advice.json, if any."""
    further = command("plan", at or folder, "--out", Path("plans") / (at or folder).resolve().name)
    look = () if written is None else (written,)
    if not advice.options:
        return Closing("No further trace could be judged.", command("check", folder), look)
    best = advice.options[0]
    narrower = f"it makes the intervals {best.mean:.2g} times as wide on average"
    return Closing(f"One more {best.test} trace ({best.says}) helps most: {narrower}.", further, look)


def of_plan(campaign: Campaign, plan: Path) -> Closing:
    """The planned tests, and the folder for their records."""
    shares = campaign.expected / campaign.now
    most = int(shares.argmin())
    answer = (
        f"{counted(len(campaign.tests), 'test')} of {campaign.seconds:.0f} s together; the standard error of "
        f"{campaign.symbols[most]} shrinks most, to {shares[most]:.2g} of now."
    )
    return Closing(answer, "make the tests as procedure.html says, then copy their records into the measurement folder "
                           "and give `etcfit fit FOLDER --out RUN`", (plan / "procedure.html",))  # fmt: skip


def of_drive(studies: Sequence[Study], folder: Path, run: Path | None) -> Closing:
    """How closely the plate follows, or the changes between two logs."""
    from ...car_log import record_next
    from ...car_log.study import verdict

    look = () if run is None else (run / "drive.html",)
    lacks = record_next([each.log for each in studies])
    if len(studies) == 2:
        return Closing(verdict(*studies), _record(lacks, folder), look)
    from ..car_log import in_a_word

    follows = [(each.tracking.rmse, each.log.name) for each in studies if each.tracking is not None]
    pairs = [each for each in studies if each.sensors is not None]
    if not follows and pairs:
        return Closing(" ".join((f"Both sensors of {pairs[0].log.name} are calibrated.", *pairs[0].sensors.findings)),  # pyright: ignore[reportOptionalMemberAccess]
                       "type the voltages into the ECU, then log a drive with its setpoint", look)  # fmt: skip
    if not follows:
        return Closing("No log has a setpoint: how closely the plate follows cannot be said.",
                       "log the setpoint as well, then give this command again", look)  # fmt: skip
    rmse, name = max(follows)
    word = in_a_word(next(each.verdict for each in studies if each.log.name == name))
    return Closing(f"{word} The plate follows its setpoint to {rmse:.2g} % of travel (rms) in {name}, at worst of "
                   f"{counted(len(follows), 'log')}.", _record(lacks, folder), look)  # fmt: skip


def _record(lacks: Sequence[Lack], folder: Path) -> str:
    """What to record first."""
    return f"log this and put it into {folder}: {lacks[0].record}"
