"""From the logs of a car to gains: import, checks, fit, diagnosis, design and the steps from the present gains.

Every stage writes the same files into the run folder as its own command; tune.json summarises them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

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
from ..rig.base import RigConfig
from ..run_folder.folder import RunFolder
from ..run_folder.manifest import digest
from ..run_folder.tune import STEP, TUNE
from .progress import Report, part_of, silent
from .views import Card, View

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..control.borne import Borne
    from ..control.design import Design
    from ..control.pid import Gains
    from ..control.proposal import GainStep
    from ..estimation.result import FitResult
    from ..estimation.settings import FitSettings
    from ..exporting.tune import OwnTune
    from ..rig.base import Rig

LOGS = "logs"  # the measurement folder, below the run folder
TIMES = {"period": "--ecu-period", "delay": "--ecu-delay"}  # field of `Ecu` -> option of `etcfit tune`
_IMPORT, _FIT, _DIAGNOSIS, _DESIGN = 0.05, 0.3, 0.55, 0.95  # share of the work that is done after each


@dataclass(frozen=True)
class TuneRequest:
    """The request of `etcfit tune`."""

    profile: str  # name of the make of ECU
    # P, I and D in the ECU's own numbers: one set, or those under which each log was made, the present ones last; () if
    # unknown
    sets: tuple[tuple[float, float, float], ...] = ()
    ecu: tuple[tuple[str, float], ...] = ()  # given properties of the ECU, by field of `Ecu`, as `period`
    supply: float | None = None  # supply voltage, V; None: as logged
    answers: Answers = field(default_factory=Answers)  # the user's answers about the columns
    anyway: bool = False  # give gains even if the model is a compromise or did not converge
    settings: TuneSettings = field(default_factory=TuneSettings)  # which part of the logs is fitted
    own: OwnTune | None = None  # settings of the user's own tune, or None; its gains count if none are given

    @property
    def gains(self) -> tuple[float, float, float] | None:
        """P, I and D that the ECU has now; None if unknown."""
        return self.sets[-1] if self.sets else None

    def for_logs(self, logs: Sequence[Path], tune_file: Path | None) -> TuneRequest:
        """The request with the settings of the user's own tune, if any; given gains take precedence over those of the
        tune.

        Raises:
            UsageError: several sets of gains, but not one for each log; or the make of ECU has no tune file.
            MeasurementError: the file is no tune, or lacks these settings.
        """
        if len(self.sets) not in (0, 1, len(logs)):
            raise UsageError(f"gains: {len(self.sets)} sets for {len(logs)} logs. Give one, or one for each log, in "
                             "their order.")  # fmt: skip
        if tune_file is None:
            return self
        from ..exporting.tune import read_tune

        own = read_tune(tune_file, named(self.profile))
        return replace(self, sets=self.sets or (own.gains,), own=own)

    def options(self, of_files: bool = False) -> list[str]:
        """The options that repeat this request, without the present gains, which change from log to log.

        Args:
            of_files: include options about these logs: a column of one of them, and the tune that made them.
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
    """The result of `etcfit tune`.

    Args:
        input: contents of the logs, and the input of the model.
        lacks: what to record next.
        result: the final model; None if the logs did not permit a fit.
        design: gains; None likewise.
        steps: sets of gains from the present to the proposed ones; () likewise.
        explained: share of the motion that the model explains, on the held-out part and on the fitted one, 0 to 1; None
            if there is none.
        why_not: why there are no gains, or none to type in; "" if there are.
        borne: tolerance of the loop to the model's error, for each new step, half way first.
        doubts: why gains would be withheld without `anyway`.
    """

    request: TuneRequest
    input: TuneInput
    lacks: tuple[Lack, ...]
    result: FitResult | None = None
    design: Design | None = None
    steps: tuple[GainStep, ...] = ()
    explained: tuple[float | None, float | None] = (None, None)
    why_not: str = ""
    borne: tuple[Borne, ...] = ()
    doubts: tuple[str, ...] = ()

    def printed(self) -> RenderableType:
        from ..reporting.tune import tune_table

        return tune_table(tuned_json(self))

    def _card(self) -> Card:
        outcome = f"none from this log. {self.why_not}" if self.why_not else f"{len(self.steps)} sets; see .steps"
        return Card(RigConfig(self.profile.title), "gains from logs of the car", (outcome,))

    @property
    def profile(self) -> EcuProfile:
        """The make of ECU."""
        return named(self.request.profile)

    @property
    def held_out_error(self) -> float | None:
        """Rms of measured - predicted on the held-out part, per cent of the travel; None if nothing was held out."""
        if self.result is None or self.result.holdout is None:
            return None
        low, high = self.result.rig.config.travel
        errors = [measured - predicted for _, measured, predicted in _positions(self.result, self.result.holdout)]
        return 100.0 * float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))) / (high - low) if errors else None

    def written(self, gains: Gains) -> Terms:
        """Gains as the ECU writes them."""
        assert self.design is not None, "gains come from a design"
        return self.design.written(gains, notation_of(self.profile))


def tune_logs(files: Sequence[Path], run: RunFolder, request: TuneRequest, report: Report = silent) -> Tuned:
    """Tune from logs; write the files of every stage, tune.json and its picture into the run folder."""
    profile = named(request.profile)
    notation_of(profile)
    given = dict(request.ecu)
    known = _known(profile, given, request)
    report("reading the logs", 0.0)
    with held(run.path):
        logs = _imported(files, request)
        prepared = tune_input(logs, re.sub(r"[^\w .-]+", "_", files[0].stem), known, request.settings)
        lacks = record_next([as_log(log, logs.config) for log in logs.measurements if "position" in log.channels])
        if prepared.stopped_by:
            why = " ".join(f"{each.says[0].upper()}{each.says[1:]}. {each.cure}" for each in prepared.stopped_by)
            found = Tuned(request, prepared, lacks, why_not=why)
        else:
            found = _fit_and_design(run, prepared, lacks, profile, given, request, report)
        keep_tuned(run.path, found, report)
    return found


def sets_of(
    gains: tuple[float, float, float] | Sequence[tuple[float, float, float]] | None,
) -> tuple[tuple[float, float, float], ...]:
    """One set of gains, or one set per log, as a tuple of sets; () for None."""
    if gains is None:
        return ()
    every: Any = [gains] if np.ndim(gains[0]) == 0 else gains
    return tuple((float(p), float(i), float(d)) for p, i, d in every)


def notation_of(profile: EcuProfile) -> Notation:
    """How a make of ECU writes gains."""
    if profile.notation is None:
        raise UsageError(
            f"{profile.title}: its maker does not publish the unit of its gains, so none can be typed in. Make a "
            f"folder of the logs (etcfit import) and fit it; etcfit design RUN --ecu {profile.name} --present P,I,D "
            "then gives gains as multiples of yours."
        )
    return profile.notation


def _known(profile: EcuProfile, given: dict[str, float], request: TuneRequest) -> KnownEcu:
    fields = profile.completed(given)
    # no maker publishes the delay: a reading acts by the next tick, and the lag of the winding absorbs the rest
    fields.setdefault("delay", fields.get("period", Ecu().period))
    if request.own is not None and request.own.integral is not None:
        fields["integral"] = request.own.integral
    bias = () if request.own is None else request.own.bias
    gains = None if request.gains is None else Terms(*request.gains)
    of_logs = tuple(Terms(*each) for each in request.sets)
    return KnownEcu(
        profile.title, Ecu(**fields), "period" in fields, notation_of(profile), gains, request.supply, of_logs, bias
    )


def _imported(files: Sequence[Path], request: TuneRequest) -> Rig:
    """The logs as the importer reads them, with every guess accepted."""
    from ..importing import import_files
    from ..importing.answers import accept_all
    from ..rig.reader import read_folder

    with TemporaryDirectory() as scratch:
        toml = Path(scratch) / "rig.toml"
        supply = request.supply or request.settings.supply  # a logged supply takes precedence
        toml.write_text(f'[rig]\nname = "logs"\nsupply_V = {supply}\n', encoding="utf-8")
        import_files(files, Path(scratch) / LOGS, request.answers, accept_all, rig=toml)
        return replace(read_folder(Path(scratch) / LOGS), folder=str(files[0]))


def fit_settings(model: str) -> FitSettings:
    """Settings of the fit. It does not search for nearby optima, which takes minutes: gains are tried over draws
    anyway. Rows moved to their ticks are accurate to the sensor's noise, so a start ten times further off still counts
    as near.
    """
    from ..estimation.settings import FitSettings, GlobalSearchSettings

    misfit = 100.0 if model == DUTY else FitSettings().misfit
    return FitSettings(neighbours=0, misfit=misfit, search=GlobalSearchSettings(epochs=60, patience=15))


def _fit_and_design(
    run: RunFolder, prepared: TuneInput, lacks: tuple[Lack, ...], profile: EcuProfile, given: dict[str, float],
    request: TuneRequest, report: Report,
) -> Tuned:  # fmt: skip
    """Fit, diagnosis and design of a folder that is sufficient for gains."""
    from ..control.pid import Gains
    from ..control.proposal import gain_steps
    from ..control.settings import DesignSettings, OptimumSettings
    from ..diagnosis import diagnose
    from ..diagnosis.settings import DiagnosisSettings
    from ..estimation.joint_fit import fit
    from ..rig.reader import read_folder
    from .work import design_of, keep_design, keep_diagnosis, keep_fit

    folder = _written(run.path / LOGS, prepared)
    rig = read_folder(folder)
    about = _graph_readings(prepared.duty_files) if prepared.duty_files else None
    result = fit(rig, part_of(report, _IMPORT, _FIT), fit_settings(prepared.model), about)
    keep_fit(run, result)
    # one round of two candidates, because a log without a current separates few effects
    brief = DiagnosisSettings(rounds=1, refits=2, rig_refits=1, folds=1, pieces=0, free_pool=0, orders=0)
    diagnosis = diagnose(result, part_of(report, _FIT, _DIAGNOSIS), brief)
    keep_diagnosis(run, diagnosis)
    final = diagnosis.after
    # the model of a logged duty contains the delay already; that of an ECU does not
    delay = 0.0 if prepared.model == DUTY else prepared.delay
    gains_request = DesignRequest(ecu={"noise": prepared.noise, "supply": prepared.supply, **given, "delay": delay},
                                  profile=profile.name, anyway=request.anyway)  # fmt: skip
    # a shorter search over fewer models, so that the command takes minutes
    short_search = DesignSettings(draws=48, optimum=OptimumSettings(few=16, searches=1, rounds=18, starts=2))
    design = design_of(final.fitted(), gains_request, None, part_of(report, _DIAGNOSIS, _DESIGN), short_search)
    present = None
    if request.gains is not None:
        low, high = rig.config.travel
        units = notation_of(profile).units(design.task.ecu, high - low)
        present = Gains(*(gain * unit for gain, unit in zip(request.gains, units, strict=True)))
    report("simulating each step", _DESIGN)
    steps, explained = gain_steps(design, present), _explained(final)
    judged = _tolerances(final, design, prepared, present, steps)
    doubts = reasons_to_withhold(final, explained[0], judged, steps)
    if not doubts:  # a compromise that the loop tolerates: stated, and gains are given
        design = replace(design, anyway=True)
    keep_design(run, final, design, replace(gains_request, anyway=design.anyway).recorded())
    why_not = "" if request.anyway else " ".join(doubts)
    return Tuned(request, prepared, lacks, final, design, steps, explained, why_not, judged, doubts)


def _tolerances(
    result: FitResult, design: Design, prepared: TuneInput, present: Gains | None, steps: Sequence[GainStep]
) -> tuple[Borne, ...]:
    """Tolerance of each new step's loop to the model's error, from the held-out part, or the fitted one if there is
    none."""
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
    """Why gains are withheld, and what to record; () if there is no reason.

    An estimate is good enough. A compromise is good enough if it explains the motion that was not fitted and the new
    loops tolerate its error, half-way step included.
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
    """Write the measurement folder again."""
    import shutil

    from ..datasets.base import write_folder

    if folder.is_dir():
        shutil.rmtree(folder)
    return write_folder(folder, prepared.files)


def _graph_readings(files: Mapping[str, str]) -> Mapping[str, float]:
    """Parameters read from the graphs of a folder, SI by symbol."""
    from ..datasets.base import write_folder
    from ..rig.paper_readings import read_graphs
    from ..rig.reader import read_folder

    with TemporaryDirectory() as scratch:
        return read_graphs(read_folder(write_folder(Path(scratch) / LOGS, files))).values


def _explained(result: FitResult) -> tuple[float | None, float | None]:
    """Share of the position's motion that is explained, held out and fitted, as `etcfit fit` computes it."""
    from ..estimation.explained import explained, share_of

    scores = (result.score_holdout, result.score_fit)
    held_out, fitted = (share_of(explained(each, result.rig.measurements), ("position",)) for each in scores)
    return held_out, fitted


def _positions(result: FitResult, problem: Any) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Instants (s), measured and predicted position (rad) of each trace that logs one, shape (n,); NaN where
    missing."""
    for trace in problem.batch.traces:
        if "position" in trace.channels:
            k = trace.channels.index("position")
            yield trace.instants, trace.data[:, k], result.predicted[trace.measurement.file][:, k]


def keep_tuned(run: Path, found: Tuned, report: Report = silent) -> None:
    """Write RUN/tune.json and RUN/pictures/tune.png."""
    from ..reporting.drawing import draw_one
    from ..reporting.tune import draw_tune

    made_with = None if found.design is None else digest(run / "pid.json")
    write_json(run / "tune.json", "tune", tuned_json(found, made_with))
    if found.steps:
        report("drawing", 0.97)
        draw_one(run / "pictures" / "tune.png", lambda: draw_tune(found))


def tuned_json(found: Tuned, pid: str | None = None) -> dict[str, Any]:
    """The object of tune.json."""
    from ..reporting.tune import says_of

    steps = [_step(found, step) for step in found.steps]
    says = says_of(found, [plain(STEP.written(step)) for step in steps])
    unit = dict(zip("PID", notation_of(found.profile).of_each, strict=True))
    return TUNE.json({"found": found, "steps": steps, "says": says, "unit": unit, "pid": pid})


def _step(found: Tuned, step: GainStep) -> dict[str, Any]:
    """A set of gains; a withheld figure, or a probability that cannot be trusted, is None."""
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
