"""The input and the result of every format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from .. import __version__
from ..control.linearise import Reduction, reduce
from ..errors import UsageError
from ..estimation.fitted_model import Fitted, body_types
from ..files import whole
from ..model.effects import AbstractEffect
from ..model.parameters import Parameter, parameters_of
from ..model.pid import Gains
from ..model.rig_effects import AbstractRigEffect
from ..model.throttle import Throttle
from ..ranges import check_ranges, real
from ..rig.user_text import c_comment, in_c, one_line

BODY: Mapping[str, tuple[str, str]] = {
    "N": ("1", "gear ratio, motor angle over plate angle"),
    "lower": ("rad", "closed stop"),
    "upper": ("rad", "open stop"),
}
"""Unit and meaning of `Source.body`."""


@dataclass(frozen=True)
class ExportSettings:
    """Settings of an export.

    Args:
        step: time step of the plant in C and of the FMU, s; equal to that of the loop in which gains are tried.
        share: operating point of the transfer function, a share of the travel.
    """

    step: float = real(5e-4, 1e-6, 0.01)
    share: float = real(0.25, 0.0, 1.0)

    __post_init__ = check_ranges


@dataclass(frozen=True, eq=False)
class Source:
    """A model to export."""

    fitted: Fitted  # the model at its optimum
    settings: ExportSettings = field(default_factory=ExportSettings)  # step and operating point
    pid: Mapping[str, Any] | None = None  # the object of pid.json; None if no gains were designed
    designing: str = "etcfit design RUN"  # the command that designs them, for messages
    into: Path | None = None  # the user's own file of that format, whose copy is changed; None for a new file
    anyway: bool = False  # write gains for an ECU even if the parameters behind them are no estimates

    @property
    def designed(self) -> Gains | None:
        """Gains of pid.json, SI; None if none were designed."""
        return None if self.pid is None else Gains(*(float(self.pid["gains"][name]) for name in Gains._fields))

    @property
    def values(self) -> Mapping[str, float]:
        """Value of every parameter, SI, by symbol."""
        return self.fitted.values

    @property
    def throttle(self) -> Throttle:
        return Throttle.build(self.effects, self.values)

    @property
    def body(self) -> Mapping[str, float]:
        """Properties of the rig for the plant, see `BODY`."""
        lower, upper = self.travel
        return {"N": self.fitted.config.gear_ratio, "lower": lower, "upper": upper}

    @property
    def travel(self) -> tuple[float, float]:
        """See `RigConfig.stops`."""
        return self.fitted.config.stops

    @cached_property
    def reduction(self) -> Reduction:
        """The linear plant, rad/V."""
        return reduce(self.fitted, share=self.settings.share)

    @property
    def effects(self) -> tuple[type[AbstractEffect], ...]:
        """Effects of the throttle itself, without those of the rig and the ECU that drove its logs."""
        return body_types(self.fitted.free_parameters.layout)

    @property
    def beyond_the_paper(self) -> tuple[type[AbstractEffect], ...]:
        """Effects in addition to those of Eqs. 1-2."""
        return tuple(effect for effect in self.effects if effect.off is not None)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of these effects, in their order."""
        return tuple(p for effect in self.effects for p in parameters_of(effect))

    @property
    def title(self) -> str:
        """One line with the name of the rig."""
        config = self.fitted.config
        return f"{config.name}{' (SYNTHETIC: its measurements were simulated)' if config.synthetic else ''}"

    @property
    def origin(self) -> str:
        """One line on the origin of the file."""
        names = ", ".join(effect.name for effect in self.effects)
        return f"Written by etcfit {__version__} (etcfit export). Effects in the model: {names}."

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions for every format, one sentence each."""
        return (*self.fitted.state.cautions, *self._own_cautions())

    def _own_cautions(self) -> Iterator[str]:
        unknown = self.fitted.identifiability.unknown
        if lost := [p.symbol for p in self.parameters if self.fitted.doubt(p.symbol) > unknown]:
            yield f"The data do not tell {', '.join(lost)} alone: these values are where the fit ended, not measured."
        types = self.fitted.free_parameters.layout.types
        if rig := [t.name for t in types if issubclass(t, AbstractRigEffect)]:
            yield (f"Left out: {', '.join(rig)}. They stand between throttle and log on the rig that was measured, "
                   "and are no part of the throttle.")  # fmt: skip
        if ecu := [t.name for t in types if not issubclass(t, AbstractRigEffect) and t.commands]:
            yield f"Left out: {', '.join(ecu)}, the ECU that drove the logs."
        if self.travel != self.fitted.config.travel:
            low, high = self.travel
            yield (f"The rig has no stops on both sides. They are set to {low:.4g} and {high:.4g} rad; "
                   "set them to yours.")  # fmt: skip


@dataclass(frozen=True)
class Export:
    """The result of a format."""

    files: Mapping[str, str | bytes]  # contents by name, relative to their folder
    cannot_hold: tuple[str, ...] = ()  # what the format leaves out or changes, one sentence each; the files say so too


@dataclass(frozen=True)
class Format:
    """A format, registered in `FORMATS`."""

    name: str  # name for `--to`
    title: str  # its purpose, one line
    make: Callable[[Source], Export]  # makes the files; imports heavy modules when called
    changes: bool = False  # whether it can change a copy of the user's own file (`Source.into`)
    tools: Callable[[], object] = lambda: None  # raises an error if this machine lacks a tool

    def require(self, into: Path | None) -> None:
        """Refuse an impossible export before there is a model.

        Args:
            into: see `Source.into`.
        Raises:
            UsageError: this machine lacks a tool, or the format cannot change the given file.
        """
        if into is not None and not self.changes:
            raise UsageError(f"--to {self.name} writes new files. Leave --into out.")
        self.tools()

    def export(self, source: Source) -> Export:
        """The files of a model.

        Raises:
            UsageError: see `require`; or the model lacks what the format needs.
        """
        self.require(source.into)
        return self.make(source)


def write(export: Export, folder: Path) -> tuple[Path, ...]:
    """Write every file of an export, or none: the old ones stay until all new ones are written.

    Returns:
        Their paths, in their order.
    """
    paths = tuple(folder / name for name in export.files)
    with ExitStack() as drafts:
        for path, content in zip(paths, export.files.values(), strict=True):
            draft = drafts.enter_context(whole(path))
            draft.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    return paths


def rendered(template: str, **parts: Any) -> str:
    """A template of this package with these values."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("etcfit.exporting", "template"),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"number": repr, "c_comment": c_comment, "in_c": in_c, "one_line": one_line}
    return environment.get_template(template).render(**parts)
