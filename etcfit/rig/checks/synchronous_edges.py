"""One clock for output and logger: every edge of the voltage comes at the same phase of the sampling interval.

A habit, no mistake, but a fit that takes each instant as independent is biased by it. See `edge_phase.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from ..finding import Finding
from .base import AbstractDetector, Records
from .edge_phase import EdgeSettings, edge_phase


@dataclass(frozen=True)
class SynchronousEdges(AbstractDetector):
    """See the module.

    Args:
        settings: what counts as in step.
    """

    settings: EdgeSettings = field(default_factory=EdgeSettings)
    kind: ClassVar[str] = "synchronous_edges"

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            found = edge_phase(traces, self.settings)
            if found is not None:
                yield Finding(self.kind, found.phase, "sample intervals", found.chance,
                              f"In {test} the voltage's edges are in step with the samples: all {found.edges} come "
                              f"{found.phase:.2f} +- {found.error:.2f} of an interval before the sample that first "
                              "shows them.",
                              "Nothing in the files is wrong: the instants of one test share one phase, which the fit "
                              "estimates.", test, channel="voltage")  # fmt: skip
