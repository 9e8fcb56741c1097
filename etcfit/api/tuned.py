"""From the logs of a car to gains: import, checks, fit, diagnosis, design and the way from the present gains, in turn.

What every stage leaves lies in the run folder as if its own command had been given; tune.json sums it up.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..car_log import Lack, record_next
from ..car_log.study import as_log
from ..control.request import DesignRequest
from ..errors import UsageError
from ..files import held, plain, write_json
from ..importing.answers import Answers
from ..importing.tuning import DUTY, ECU, KnownEcu, TuneInput, TuneSettings, tune_input
from ..model.ecu import Ecu, Notation, Terms
from ..model.ecus import EcuProfile, named
from ..run_folder.folder import RunFolder
from ..run_folder.manifest import digest
from ..run_folder.tune import STEP, TUNE
from .progress import Report, part_of, silent
from .views import View

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..control.borne import Borne
    from ..control.design import Design
    from ..control.pid import Gains
    from ..control.proposal import GainStep
    from ..control.settings import DesignSettings
    from ..diagnosis.settings import DiagnosisSettings
    from ..estimation.result import FitResult
    from ..estimation.settings import FitSettings
    from ..exporting.tune import OwnTune
    from ..rig.base import Rig

LOGS = "logs"  # the measurement folder, below the run folder
TIMES = {"period": "--ecu-period", "delay": "--ecu-delay"}  # field of `Ecu` -> option of `etcfit tune`
_IMPORT, _FIT, _DIAGNOSIS, _DESIGN = 0.05, 0.3, 0.55, 0.95  # of the work, when each is done


@dataclass(frozen=True)
class TuneRequest:
    """What gains are asked for.

    Args:
        profile: name of the make of ECU.
        gains: P, I and D that are in it now, as it writes them; None where nobody knows.
        ecu: what is given of the ECU, by field of `Ecu`, as `period`.
        supply: V; None for what the log says.
        answers: what the user said of the columns.
        anyway: give gains even where the model is a compromise or did not converge.
        settings: what of the logs is fitted.
        of_logs: gains under which each log was made, where somebody said so; the last of them are in it now.
        own: what the user's own tune says; its gains count where none are given. None where there is none.
    """

    profile: str
    gains: tuple[float, float, float] | None = None
    ecu: tuple[tuple[str, float], ...] = ()
    supply: float | None = None
    answers: Answers = field(default_factory=Answers)
    anyway: bool = False
    settings: TuneSettings = field(default_factory=TuneSettings)
    of_logs: tuple[tuple[float, float, float], ...] = ()
    own: OwnTune | None = None

    def with_tune(self, file: Path) -> TuneRequest:
        """With what the user's own tune says; gains that are given go before its own.

        Raises:
            UsageError: the make of ECU has no tune file.
            MeasurementError: it is no tune, or one without these settings.
        """
        from ..exporting.tune import read_tune

        own = read_tune(file, named(self.profile))
        return replace(self, gains=self.gains or own.gains, own=own)

    def options(self, of_files: bool = False) -> list[str]:
        """The options that ask for it once more, the present gains apart, which change from log to log.

        Args:
            of_files: those too that are about these logs: a column of one of them, and the tune that made them.
        """
        words = ["--ecu", self.profile]
        for key, value in self.ecu:
            if option := TIMES.get(key):
                words += [option, f"{1e3 * value:.10g}ms"]
        if of_files and self.own is not None:
            words += ["--msq", self.own.file]
        if self.supply is not None:
            words += ["--supply", f"{self.supply:.10g}"]
        if self.settings.hold_out != TuneSettings().hold_out:
            words += ["--hold-out", f"{100.0 * self.settings.hold_out:.10g}"]
        for option in self.answers.options(of_files):
            words += ["--column", option]
        return [*words, *(["--anyway"] if self.anyway else [])]


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(View):
    """What logs of a car came to.

    Args:
        input: what the logs hold, and what drives the model.
        lacks: what to record next.
        result: the final model; None where the logs stop it before.
        design: gains; None likewise.
        steps: from the present gains to the proposed ones; () likewise.
        explained: share of the motion that the model explains, on the held-out part and on the fitted one, 0 to 1; None
            where there is none.
        why_not: why there are no gains, or none to type in; "" where there are.
        borne: what the loop of each new step bears, half way first.
        doubts: why gains would be withheld without `anyway`.
    """

    asked: TuneRequest
    input: TuneInput
    lacks: tuple[Lack, ...]
    result: FitResult | None = None
    design: Design | None = None
    steps: tuple[GainStep, ...] = ()
    explained: tuple[float | None, float | None] = (None, None)
    why_not: str = ""
    borne: tuple[Borne, ...] = ()
    doubts: tuple[str, ...] = ()

    def _printed(self) -> RenderableType:
        from ..reporting.tune import tune_table

        return tune_table(tuned_json(self))

    def __repr__(self) -> str:
        said = f"not from this log. {self.why_not}" if self.why_not else f"{len(self.steps)} sets of gains; see .steps"
        return f"Gains for {self.profile.title} from logs of the car: {said}"

    @property
    def profile(self) -> EcuProfile:
        """The make of ECU."""
        return named(self.asked.profile)

    @property
    def held_out_error(self) -> float | None:
        """Rms of measured - predicted on the held-out part, per cent of the travel; None where nothing was held out."""
        if self.result is None or self.result.holdout is None:
            return None
        low, high = self.result.rig.config.travel
        errors = [measured - predicted for _, measured, predicted in _positions(self.result, self.result.holdout)]
        return 100.0 * float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))) / (high - low) if errors else None

    def written(self, gains: Gains) -> Terms:
        """Gains as the ECU writes them."""
        assert self.design is not None, "gains come from a design"
        return self.design.written(gains, notation_of(self.profile))


def tune_logs(files: Sequence[Path], run: RunFolder, asked: TuneRequest, report: Report = silent) -> Tuned:
    """From logs to gains; the run folder has what every stage made, and tune.json with its picture.

    Raises:
        MeasurementError: a file cannot be read, or no log has a position with a duty or setpoint beside it.
        UsageError: no such make of ECU, or a field given that its source fixes otherwise.
    """
    profile = named(asked.profile)
    notation_of(profile)
    given = dict(asked.ecu)
    if clash := profile.clashes(given):
        raise UsageError(f"{clash[0]}: {profile.title} fixes it at {profile.fixes[clash[0]]:g}. Leave it out.")
    report("reading the logs", 0.0)
    with held(run.path):
        known = _known(profile, given, asked)
        logs = _imported(files, asked)
        prepared = tune_input(logs, re.sub(r"[^\w .-]+", "_", files[0].stem), known, asked.settings)
        lacks = record_next([as_log(log, logs.config) for log in logs.measurements if "position" in log.channels])
        if prepared.stopped_by:
            why = " ".join(f"{each.says[0].upper()}{each.says[1:]}. {each.cure}" for each in prepared.stopped_by)
            found = Tuned(asked, prepared, lacks, why_not=why)
        else:
            found = _worked_out(run, prepared, lacks, profile, given, asked, report)
        keep_tuned(run.path, found, report)
    return found


def sets_of(
    gains: tuple[float, float, float] | Sequence[tuple[float, float, float]] | None,
) -> tuple[tuple[float, float, float], ...]:
    """One set of gains or one a log, as sets; none of None."""
    if gains is None:
        return ()
    every: Any = [gains] if np.ndim(gains[0]) == 0 else gains
    return tuple((float(p), float(i), float(d)) for p, i, d in every)


def notation_of(profile: EcuProfile) -> Notation:
    """How a make of ECU writes gains.

    Raises:
        UsageError: its maker does not publish that.
    """
    if profile.notation is None:
        raise UsageError(
            f"{profile.title}: its maker does not publish the unit of its gains, so none can be typed in. Make a "
            f"folder of the logs (etcfit import) and fit it; etcfit design RUN --ecu {profile.name} --present P,I,D "
            "then gives gains as multiples of yours."
        )
    return profile.notation


def _known(profile: EcuProfile, given: dict[str, float], asked: TuneRequest) -> KnownEcu:
    fields = profile.completed(given)
    # nobody publishes it: what is read at a tick acts by the next one, and the lag of the winding takes up the rest
    fields.setdefault("delay", fields.get("period", Ecu().period))
    if asked.own is not None and asked.own.integral is not None:
        fields["integral"] = asked.own.integral
    bias = () if asked.own is None else asked.own.bias
    gains = None if asked.gains is None else Terms(*asked.gains)
    of_logs = tuple(Terms(*each) for each in asked.of_logs)
    return KnownEcu(
        profile.title, Ecu(**fields), "period" in fields, notation_of(profile), gains, asked.supply, of_logs, bias
    )


def _imported(files: Sequence[Path], asked: TuneRequest) -> Rig:
    """The logs as the importer reads them, every guess taken."""
    from ..importing import import_files
    from ..importing.answers import accept_all
    from ..rig.reader import read_folder

    with TemporaryDirectory() as scratch:
        toml = Path(scratch) / "rig.toml"
        supply = asked.supply or asked.settings.supply  # a logged one goes before it
        toml.write_text(f'[rig]\nname = "logs"\nsupply_V = {supply}\n', encoding="utf-8")
        import_files(files, Path(scratch) / LOGS, asked.answers, accept_all, rig=toml)
        return replace(read_folder(Path(scratch) / LOGS), folder=str(files[0]))


def fit_settings(model: str) -> FitSettings:
    """Of the fit: optima nearby are not looked for, which takes minutes, for gains are tried over draws anyway. Rows at
    their ticks are good to the sensor's noise, so that a start ten times further off is near all the same.
    """
    from ..estimation.settings import FitSettings, GlobalSearchSettings

    misfit = 100.0 if model == DUTY else FitSettings().misfit
    return FitSettings(neighbours=0, misfit=misfit, search=GlobalSearchSettings(epochs=60, patience=15))


def diagnosis_settings() -> DiagnosisSettings:
    """Of the diagnosis: one round of two candidates, for a log without a current tells few effects apart."""
    from ..diagnosis.settings import DiagnosisSettings

    return DiagnosisSettings(rounds=1, refits=2, rig_refits=1, folds=1, pieces=0, pair_refits=0, free_pool=0)


def design_settings() -> DesignSettings:
    """Of the design: a shorter search over fewer models, so that all is done in minutes."""
    from ..control.settings import DesignSettings, OptimumSettings

    return DesignSettings(draws=48, optimum=OptimumSettings(few=16, searches=1, rounds=18, starts=2))


def _worked_out(
    run: RunFolder, prepared: TuneInput, lacks: tuple[Lack, ...], profile: EcuProfile, given: dict[str, float],
    asked: TuneRequest, report: Report,
) -> Tuned:  # fmt: skip
    """Fit, diagnosis and design of a folder that can tell gains."""
    from ..control.pid import Gains
    from ..control.proposal import gain_steps
    from ..diagnosis import diagnose
    from ..estimation.joint_fit import fit
    from ..rig.reader import read_folder
    from .work import design_of, keep_design, keep_diagnosis, keep_fit

    folder = _written(run.path / LOGS, prepared)
    rig = read_folder(folder)
    about = _read_off(prepared.duty_files) if prepared.duty_files else None
    result = fit(rig, part_of(report, _IMPORT, _FIT), fit_settings(prepared.model), about)
    keep_fit(run, result)
    diagnosis = diagnose(result, part_of(report, _FIT, _DIAGNOSIS), diagnosis_settings())
    keep_diagnosis(run, diagnosis)
    final = diagnosis.after
    # the delay is in the model of a logged duty already, and no part of that of an ECU
    delay = 0.0 if prepared.model == DUTY else prepared.delay
    request = DesignRequest(ecu={"noise": prepared.noise, "supply": prepared.supply, **given, "delay": delay},
                            profile=profile.name, anyway=asked.anyway)  # fmt: skip
    design = design_of(final.fitted(), request, None, part_of(report, _DIAGNOSIS, _DESIGN),
                       design_settings())  # fmt: skip
    present = None
    if asked.gains is not None:
        low, high = rig.config.travel
        units = notation_of(profile).units(design.task.ecu, high - low)
        present = Gains(*(gain * unit for gain, unit in zip(asked.gains, units, strict=True)))
    report("what each step does", _DESIGN)
    steps, explained = gain_steps(design, present), _explained(final)
    judged = _borne(final, design, prepared, present, steps)
    doubts = reasons_to_withhold(final, explained[0], judged, steps)
    if not doubts:  # of a compromise that the loop bears: said, and given
        design = replace(design, anyway=True)
    keep_design(run, final, design, replace(request, anyway=design.anyway).recorded())
    why_not = "" if asked.anyway else " ".join(doubts)
    return Tuned(asked, prepared, lacks, final, design, steps, explained, why_not, judged, doubts)


def _borne(
    result: FitResult, design: Design, prepared: TuneInput, present: Gains | None, steps: Sequence[GainStep]
) -> tuple[Borne, ...]:
    """What the loop of each new step bears, by the part held out; by the fitted one where there is none."""
    from ..control.borne import borne
    from ..control.proposal import PRESENT

    problem = result.holdout or result.problem
    parts = list(_positions(result, problem))
    drove = present if prepared.model == ECU else None
    return tuple(borne(parts, prepared.noise, design.task.plant, design.task.ecu, step.gains, drove)
                 for step in steps if step.name != PRESENT)  # fmt: skip


def reasons_to_withhold(
    result: FitResult, explained: float | None, judged: Sequence[Borne], steps: Sequence[GainStep]
) -> tuple[str, ...]:
    """Why gains are withheld, and what to record; () where there is no reason.

    An estimate is good enough. A compromise is where it explains the motion that was not fitted and the new loops bear
    what it misses, half-way step included.
    """
    from ..control.proposal import not_held
    from ..estimation.explained import judged as enough

    state, found = result.state, list[str]()
    if not state.converged:
        found.append(f"{state.cautions[0]} Record more quick steps, with rests between them.")
    if explained is not None and enough(explained).word != "good":
        found.append(f"{enough(explained).says} Record at each tick of the ECU, over the whole travel.")
    if state.compromise is not None and (missed := [each for each in judged if not each.enough]):
        found.append(f"{state.cautions[-1]} {missed[-1].says}")
    if unheld := not_held(steps):
        found.append(unheld)
    return tuple(found)


def _written(folder: Path, prepared: TuneInput) -> Path:
    """The measurement folder, anew."""
    import shutil

    from ..datasets.base import write_folder

    if folder.is_dir():
        shutil.rmtree(folder)
    return write_folder(folder, prepared.files)


def _read_off(files: Mapping[str, str]) -> Mapping[str, float]:
    """What the graphs of a folder tell, SI by symbol."""
    from ..datasets.base import write_folder
    from ..rig.paper_readings import read_graphs
    from ..rig.reader import read_folder

    with TemporaryDirectory() as scratch:
        return read_graphs(read_folder(write_folder(Path(scratch) / LOGS, files))).values


def _explained(result: FitResult) -> tuple[float | None, float | None]:
    """Share of the position's motion, held out and fitted, as `etcfit fit` has it."""
    from ..estimation.explained import explained, share_of

    scores = (result.score_holdout, result.score_fit)
    held_out, fitted = (share_of(explained(each, result.rig.measurements), ("position",)) for each in scores)
    return held_out, fitted


def _positions(result: FitResult, problem: Any) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Instants (s), measured and predicted position (rad) of each trace with one, shape (n,); NaN where none is."""
    for trace in problem.batch.traces:
        if "position" in trace.channels:
            k = trace.channels.index("position")
            yield trace.instants, trace.data[:, k], result.predicted[trace.measurement.file][:, k]


def keep_tuned(run: Path, found: Tuned, report: Report = silent) -> None:
    """RUN/tune.json and RUN/pictures/tune.png."""
    from ..reporting.tune import draw_tune

    made_with = None if found.design is None else digest(run / "pid.json")
    write_json(run / "tune.json", "tune", tuned_json(found, made_with))
    if found.steps:
        report("drawing", 0.97)
        draw_tune(run / "pictures" / "tune.png", found)


class _Written(NamedTuple):
    found: Tuned
    steps: list[dict[str, Any]]
    says: dict[str, Any]
    unit: dict[str, str]
    pid: str | None


def tuned_json(found: Tuned, pid: str | None = None) -> dict[str, Any]:
    """The object of tune.json.

    Args:
        pid: SHA-256 of the pid.json that it goes with.
    """
    from ..reporting.tune import says_of

    steps = [_step(found, step) for step in found.steps]
    says = says_of(found, [plain(STEP.written(step)) for step in steps])
    unit = dict(zip("PID", notation_of(found.profile).of_each, strict=True))
    return plain(TUNE.written(_Written(found, steps, says, unit, pid)))


def _step(found: Tuned, step: GainStep) -> dict[str, Any]:
    """A set of gains: what is withheld, or not to be believed as a probability, is None."""
    withheld = bool(found.why_not)
    doubted = bool(withheld or found.doubts or (found.result is not None and found.result.state.cautions))
    written = found.written(step.gains)._asdict()
    first = found.written(found.steps[0].gains)._asdict()
    hidden = withheld and step.name != "present"
    factors = {key: written[key] / first[key] if first[key] else None for key in "PID"}
    return {
        "step": step,
        "gains": None if hidden else written,
        "factors": None if hidden or len(found.steps) == 1 else factors,
        "believed": None if doubted else step,
    }
