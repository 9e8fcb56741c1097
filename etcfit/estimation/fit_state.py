"""How far a fit can be believed, in a form that every later stage carries."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FitState:
    """The state in which a fit ended.

    Args:
        chi2_per_dof: of its residual.
        converged, reason: whether at an optimum, and in words why (not).
        compromise: why its parameters are no estimates; None where they are.
    """

    chi2_per_dof: float
    converged: bool
    reason: str
    compromise: str | None

    @property
    def cautions(self) -> tuple[str, ...]:
        """What a reader of anything made from it must know, a sentence each; none of a sound fit."""
        unfinished = () if self.converged else (f"The fit behind this did NOT CONVERGE: {self.reason}.",)
        if self.compromise is None:
            return unfinished
        return (*unfinished, f"The parameters behind this are a compromise, not estimates: {self.compromise}.")


SOUND = FitState(1.0, True, "", None)
"""Of a model that nobody had to fit."""
