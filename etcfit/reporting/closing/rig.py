"""How the commands end that look at measurements and fit nothing: check, advice, plan, logs from the car."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import command
from ...rig.base import ALLOWED_FOR
from ..numbers import counted
from . import Closing, first_few, mended

if TYPE_CHECKING:  # a check needs none of what these load
    from ...car_log import Study
    from ...car_log.coverage import Lack
    from ...experiment.advice import Advice
    from ...experiment.campaign import Campaign
    from ...experiment.check import CheckResult


def of_check(result: CheckResult, folder: Path) -> Closing:
    """What the traces of a folder that can be fitted can tell, or what is wrong with the rig."""
    verdict = result.identifiability
    assert verdict is not None, "a folder that can be fitted"
    fit = command("fit", folder, "--out", Path("runs") / folder.resolve().name)
    mistakes = [each for each in result.rig.findings if each.kind not in ALLOWED_FOR]
    lost = f"; they cannot tell {first_few(verdict.lost)}" if verdict.lost else ""
    told = f"{counted(len(result.traces), 'trace')} can tell the parameters of Eqs. 1-2{lost}."
    if mistakes:
        found = f"The records show {counted(len(mistakes), 'mistake')} of the rig: {mistakes[0].found} {told}"
        return Closing(found, mended(mistakes[0].mend, folder, command("check", folder)))
    return Closing(told, fit)


def of_advice(advice: Advice, folder: Path, at: Path | None, written: Path | None) -> Closing:
    """Which further trace helps most; folder and run `at` as the user typed them, `written` is advice.json, if any."""
    further = command("plan", at or folder, "--out", Path("plans") / (at or folder).resolve().name)
    look = () if written is None else (written,)
    if not advice.options:
        return Closing("No further trace could be judged.", command("check", folder), look)
    best = advice.options[0]
    narrower = f"it makes the intervals {best.mean:.2g} times as wide on average"
    return Closing(f"One more {best.test} trace ({best.says}) helps most: {narrower}.", further, look)


def of_plan(campaign: Campaign, plan: Path) -> Closing:
    """The tests that were planned, and where their records go."""
    shares = campaign.expected / campaign.now
    most = int(shares.argmin())
    answer = (
        f"{counted(len(campaign.tests), 'test')} of {campaign.seconds:.0f} s together; the standard error of "
        f"{campaign.symbols[most]} shrinks most, to {shares[most]:.2g} of now."
    )
    return Closing(answer, "make the tests as procedure.html says, then copy their records into the measurement folder "
                           "and give `etcfit fit FOLDER --out RUN`", (plan / "procedure.html",))  # fmt: skip


def of_drive(studies: Sequence[Study], folder: Path, run: Path | None) -> Closing:
    """How closely the plate follows, or what two logs have changed."""
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
    """What to record, of what wins most."""
    return f"log this and put it into {folder}: {lacks[0].record}"
