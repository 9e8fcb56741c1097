"""A transfer function as a notebook holds it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..control.frequency import FrequencyResponse
from ..control.linearise import SYMBOLS, UNITS, Reduction
from ..reporting.numbers import Digits, short
from . import words
from .fit import Fit
from .frames import indexed

if TYPE_CHECKING:
    import control

    from .plots import ReductionPlots

_NAMES = ("b0", "a2", "a1", "a0")


@dataclass(frozen=True, eq=False, repr=False)
class Reduced:
    """The linear plant about an operating point: `etcfit.reduce(fit)`.

        G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0)

    Args:
        fit: the model.
        reduction: of it.
        response: what the rig's sine traces say; None where it has none.
    """

    fit: Fit
    reduction: Reduction
    response: FrequencyResponse | None = None

    @property
    def transfer_function(self) -> control.TransferFunction:
        """For python-control, without delay and sensor lag; see `to_control`."""
        return self.reduction.to_control()

    def to_control(self, pade_order: int = 0) -> control.TransferFunction:
        """For python-control; with delay and sensor lag where the order of a Pade approximation is given."""
        return self.reduction.to_control(pade_order)

    @property
    def coefficients(self) -> pd.DataFrame:
        """b0, a2, a1, a0: value and stderr."""
        plant = self.reduction.plant
        values = np.array([*plant.num, *plant.den[1:]], dtype=float)
        return indexed({"value": values, "stderr": np.array(self.reduction.stderr, dtype=float)}, _NAMES, "coefficient")

    @property
    def feedforward(self) -> pd.DataFrame:
        """kS, kV and kA of v = kS sgn(w) + kV w + kA dw/dt: value, stderr and unit."""
        found = self.reduction.constants
        assert found is not None, "`etcfit.reduce` asks for them"
        columns = {"value": found.values, "stderr": found.stderr, "unit": np.array(UNITS)}
        return indexed(columns, SYMBOLS, "constant")

    @property
    def stderr(self) -> pd.Series:
        """Standard errors of b0, a2, a1, a0."""
        return pd.Series(self.coefficients["stderr"])

    @property
    def poles(self) -> Any:
        """Slowest first, 1/s, complex, shape (3,)."""
        return self.reduction.plant.poles

    @property
    def unit(self) -> str:
        """Of the gain: output over input."""
        return f"{self.reduction.output_unit}/{self.reduction.input_unit}"

    @property
    def plot(self) -> ReductionPlots:
        """Pictures: `plot.bode()`, `plot.sines()`."""
        from .plots import ReductionPlots

        return ReductionPlots(self.fit.result.fitted(), self.reduction, self.response)

    def summary(self, width: int = 140) -> str:
        """What `etcfit reduce` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.control.tables import reduction_table, sine_table

        text = render(reduction_table(self.fit.result.fitted(), self.reduction, 0), width)
        return text if self.response is None else text + render(sine_table(self.response), width)

    def save(self, run: str | Path, pade_order: int = 0) -> Path:
        """Write transfer_function.json and the Bode plot to a run folder, and what the sine traces say.

        Args:
            run: made if absent.
            pade_order: of the delay in `with_delay_and_lag` of the file; 0 leaves that out.
        Raises:
            UsageError: another model lies in RUN.
        """
        from ..run_folder import RunFolder
        from .saving import keep_reduction

        folder = RunFolder(run)
        folder.refuse_other_model(self.fit.result)
        keep_reduction(folder, self.fit.result, self.reduction, self.response, pade_order)
        return Path(run)

    @property
    def _where(self) -> str:
        gain = f"static gain {short(self.reduction.plant.dc_gain, 4)} {self.unit}"
        return f"about {100.0 * self.reduction.share:.0f} % of the travel; {gain}"

    @property
    def _poles(self) -> str:
        return "poles, 1/s: " + ", ".join(_pole(complex(pole)) for pole in self.poles)

    def _rows(self) -> list[tuple[str, str, str]]:
        """Coefficient, value and standard error."""
        plant = self.reduction.plant
        every = zip(_NAMES, (*plant.num, *plant.den[1:]), self.reduction.stderr.tolist(), strict=True)
        return [(name, Digits.of(value, spread)(value), Digits.of(value, spread)(spread))
                for name, value, spread in every]  # fmt: skip

    def __repr__(self) -> str:
        return words.block(
            f"Transfer function of {words.name_of(self.fit.result.rig.config)}: "
            f"b0 / (s^3 + a2 s^2 + a1 s + a0), {self.unit}",
            self._alarm,
            ", ".join(f"{name} {value} ± {spread}" for name, value, spread in self._rows()),
            self._where,
            self._poles,
        )

    @property
    def _alarm(self) -> str:
        return " ".join(self.fit.result.state.cautions)

    def _repr_html_(self) -> str:
        return words.card(
            self.fit.result.rig.config,
            f"b0 / (s³ + a2 s² + a1 s + a0), {self.unit}",
            words.table(("", "value", "std. error"), self._rows()),
            words.paragraph(self._where),
            words.paragraph(self._poles),
            alarm=self._alarm,
        )


def _pole(pole: complex) -> str:
    """ "-81" or "-16.3 + 5.2j"."""
    if not pole.imag:
        return short(pole.real, 4)
    return f"{short(pole.real, 4)} {'+' if pole.imag > 0.0 else '-'} {short(abs(pole.imag), 4)}j"
