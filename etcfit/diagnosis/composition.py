"""Every effect that a rig could show, those that its checks state, and the models that contain some of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..model.effects import EFFECTS, PAPER, AbstractEffect
from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect, Place, SeriesResistance, at_places
from ..problem.free_parameters import FreeParameters, Layout, free_parameters
from ..problem.jacobian import AT_ONCE
from ..problem.trace import Trace, by_test
from ..rig.base import Finding, Rig

# ---- Which effects of the rig its checks state, read off the records before any fit, and how large


def stated_effects(
    findings: Iterable[Finding], candidates: Iterable[type[AbstractEffect]]
) -> dict[type[AbstractEffect], float]:
    """Effects that the findings state, those of the rig at the place of the finding; and the value of each one's first
    parameter, SI."""
    families = [e for e in candidates if e.stated]
    return {
        effect: effect.stated[finding.kind](finding.size)
        for finding in findings
        for effect in families
        if finding.kind in effect.stated and _is_at(effect, finding)
    }


def _is_at(effect: Effect, finding: Finding) -> bool:
    """Whether a finding is about the place of an effect; an effect of the throttle has no place."""
    if not issubclass(effect, AbstractRigEffect):
        return True
    place = effect.place
    return (place.test, place.file) == (finding.test or "", "") and place.channel in ("", finding.channel)


# ---- Every effect that a rig could show, and the models that have some of them in it
#
# An effect is taken out of a model by holding its parameters at their off values, at which it contributes exactly zero:
# which of them are at work is data, so that a model compiles once. Effects of the rig itself act around the throttle,
# not in it: dozens of them cost little, and all are tried by one program.

Effect = type[AbstractEffect]

_MORE = 12  # room for further free parameters, so that few models are compiled twice


@dataclass(frozen=True, eq=False)
class Composition:
    """Every effect that may be at work in a rig, all but the known ones at their off values."""

    whole: FreeParameters  # unknowns of the model with all effects at work
    known: tuple[Effect, ...]  # effects that are at work from the start: Eqs. 1-2 and those that rig.toml names.
    candidates: tuple[Effect, ...]  # the others
    # those of them that the rig's checks found before any fit, and the first parameter of each, SI
    stated: Mapping[Effect, float] = field(default_factory=dict)

    @property
    def of_the_rig(self) -> tuple[Effect, ...]:
        """The candidates that act around the throttle."""
        return tuple(e for e in self.candidates if is_of_the_rig(e))

    @property
    def prompt(self) -> tuple[Effect, ...]:
        """Those of them that delay no signal and that are not of one trace alone.

        A delay needs the path to be kept, which makes the model dear for all other effects; effects of one trace may be
        hundreds."""
        return tuple(e for e in self.of_the_rig if not e.delays and e.scope != "trace")

    @property
    def inside(self) -> tuple[Effect, ...]:
        """The candidates that act in the throttle."""
        return tuple(e for e in self.candidates if not is_of_the_rig(e))

    def with_asleep(self, asleep: tuple[Effect, ...], added: tuple[Effect, ...]) -> FreeParameters:
        """Free parameters of the model in which some candidates are at work and others are held at their off values."""
        base = sum(1 for s in self.whole.layout.free if not any(s in resting(e) for e in self.candidates)) + _MORE
        whole = self._of((*asleep, *added), added)
        return replace(whole, layout=replace(whole.layout, room=room(max(base, len(whole.layout.free)))))

    def lean(self, added: tuple[Effect, ...]) -> FreeParameters:
        """As `with_asleep`, with equal coordinates, of a model that contains only the effects at work."""
        return self._of(added, added)

    def on_trial(self, added: tuple[Effect, ...]) -> FreeParameters:
        """As `lean`; a model with an effect of the rig contains the other effects of the rig at their off values.

        So one compiled program serves all of these effects, and another all that delay a signal. An effect of one trace
        is in a model of its own, because there may be hundreds."""
        rigs = [e for e in added if is_of_the_rig(e)]
        late = (
            tuple(e for e in self.of_the_rig if e.delays and e.scope != "trace") if any(e.delays for e in rigs) else ()
        )
        return self._of((*added, *self.prompt, *late) if rigs else added, added)

    def with_the_rig(self, added: tuple[Effect, ...]) -> FreeParameters:
        """The lean model with every candidate of the rig that is `prompt` at work besides these."""
        every = tuple(dict.fromkeys((*added, *self.prompt)))
        return self._of(every, every)

    def _of(self, present: tuple[Effect, ...], at_work: tuple[Effect, ...]) -> FreeParameters:
        """Unknowns of a model with some candidates in it; those of them not at work are held at their off values."""
        whole = self.whole.layout
        gone = {s for e in self.candidates if e not in present for s in resting(e)}
        asleep = {s: v for e in present if e not in at_work for s, v in resting(e).items()}
        free = tuple(s for s in whole.free if s not in gone and s not in asleep)
        fixed = dict(zip(whole.held, self.whole.held.tolist(), strict=True))
        held = {s: v for s, v in fixed.items() if s not in gone} | {s: v for s, v in asleep.items() if s in whole.free}
        types = tuple(t for t in whole.types if t in self.known or t in present)
        parameters = tuple(p for p in whole.parameters if p.symbol not in gone)
        layout = Layout(types, parameters, free, tuple(held), whole.ties)
        priors = {s: v for s, v in self.whole.priors.items() if s in free}
        return FreeParameters(layout, np.array(list(held.values())), priors, self.whole.start)


def compose(
    rig: Rig,
    traces: tuple[Trace, ...],
    further: tuple[Effect, ...] = (),
    only: tuple[Effect, ...] | None = None,
    held_out: tuple[Trace, ...] = (),
) -> Composition:
    """The model of every effect that these traces could show.

    Args:
        rig: whose rig.toml says what is fixed and which effects are known.
        traces: what was logged decides which effects could show (`needs` of an effect).
        further: effects that are not in the catalogue.
        only: effects of both catalogues that are considered in addition to those that rig.toml names; None: all.
        held_out: traces that are not fitted: where a test has one of them, its only fitted trace may be wrong by
            itself.
    """
    seen = logged(rig, traces)
    fitted = by_file(traces)
    of_rigs = at_places(by_test(traces), fitted | by_file(held_out))
    catalogue = (*EFFECTS, *(e for e in of_rigs if not e.place.file or e.place.file in fitted))
    fitting = [e for e in (catalogue if only is None else only) if e not in PAPER and set(e.needs) <= seen]
    names = dict.fromkeys((*rig.config.effects, *(e.name for e in sorted(fitting, key=catalogue.index))))
    whole = free_parameters(
        replace(rig.config, effects=tuple(names)), tuple(e for e in further if set(e.needs) <= seen)
    )
    declared = {SeriesResistance.at(Place(test)) for test in rig.config.series_ohm}

    def at_work(effect: Effect) -> bool:
        return effect in PAPER or effect.commands or effect.name in rig.config.effects or effect in declared

    known = tuple(e for e in whole.layout.types if at_work(e))
    candidates = tuple(e for e in whole.layout.types if e not in known)
    return Composition(whole, known, candidates, stated_effects(rig.findings, candidates))


def logged(rig: Rig, traces: tuple[Trace, ...]) -> frozenset[str]:
    """Which of the things that effects need (`needs`) the traces show: a driven winding, a current, a position, a known
    gear ratio, a bridge that the checks found."""
    words = {
        "circuit": any(t.circuit for t in traces),
        "current": any("current" in t.channels for t in traces),
        "position": any("position" in t.channels for t in traces),
        "gear": rig.config.gear_ratio_given,
        "bridge": any(finding.kind == "coasting_bridge" for finding in rig.findings),
    }
    return frozenset(word for word, true in words.items() if true)


def by_file(traces: tuple[Trace, ...]) -> dict[str, frozenset[str]]:
    """What each trace logged by itself; without traces that an ECU in the model drives, because their loop is closed
    over the delayed signals."""
    return {trace.measurement.file: trace.logged for trace in traces if not trace.controlled}


def is_of_the_rig(effect: Effect) -> bool:
    """Whether the effect acts around the throttle rather than in it."""
    return issubclass(effect, AbstractRigEffect)


def is_of_one_channel(effect: Effect) -> bool:
    """Whether the effect is of the rig, in one channel of one trace."""
    return issubclass(effect, AbstractRigEffect) and bool(effect.place.file and effect.place.channel)


def resting(effect: Effect) -> dict[str, float]:
    """Amplitudes at their off values and shapes at their nominal ones, SI by symbol."""
    off = effect.off or {}
    return {p.symbol: off.get(p.symbol, p.nominal) for p in parameters_of(effect)}


def room(count: int) -> int:
    """Length to which a vector of so many parameters is padded."""
    return AT_ONCE * math.ceil(count / AT_ONCE)


def carried(x: np.ndarray, old: Layout, new: FreeParameters, values: Mapping[str, Any]) -> np.ndarray:
    """Coordinates of another choice of free parameters, shape (P_new,).

    Args:
        x: coordinates, shape (P_old,); parameters free in both choices keep theirs.
        old: layout of those.
        new: the other choice.
        values: SI by symbol, for the parameters that become free.
    Raises:
        KeyError: a parameter that becomes free has no value.
    """
    at = dict(zip(old.free, x.tolist(), strict=True))
    layout = new.layout
    out = [at[s] if s in at else layout.parameter(s).domain.coordinate(float(values[s])) for s in layout.free]
    return np.array(out)
