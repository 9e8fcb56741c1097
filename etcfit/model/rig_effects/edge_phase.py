"""Output and logger on one clock: every edge of the voltage comes at the same place between two samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place

_WITHIN = (0.0, 1.0)


class EdgePhase(AbstractRigEffect):
    """t_edge = t_k + s (t_(k+1) - t_k),    s = edge_phase + turn, in the traces of one test.

    The turn, 0 or 1, is each edge's own: where edges come with the samples, a clock that jitters shows some of them one
    sample later than others. s stays within its interval: beyond it a step would run backwards, and meet stops that
    were never hit. Whether it lies at an end is decided apart (`estimation.edges`). A habit, no mistake: the
    fit finds it (`estimation.edges`), no diagnosis tries it.

    Source: GUM (JCGM 100:2008), 4.3, for an instant that is systematic and not drawn anew at each edge.
    """

    kind = "edge_phase"
    acts_on: ClassVar[tuple[str, ...]] = ("voltage",)
    told_by = "the timing of the rig's output and logger"
    off: ClassVar[Mapping[str, float] | None] = {"edge_phase": 0.5}
    edge_phase: Scalar = parameter(
        "", Real(1.0), 0.5, "share of a sample interval from a sample to the edge after it", "JCGM 100:2008, 4.3"
    )

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """None: edges that are not in step have no phase to be tried."""
        return ()

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        edge = steps.edge
        if edge is None:
            return steps
        late = self.here(test_of, steps.trace) * (jnp.clip(self.edge_phase + edge.turn, *_WITHIN) - 0.5)
        return steps._replace(dt=steps.dt + late * edge.span, time=steps.time + late * edge.moves)
