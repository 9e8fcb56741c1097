"""Where `etcfit fit` spends its time: the very command in this process, with clocks around its stages.

    python -m benchmarks.stages FOLDER RUN

One line of JSON on stdout, seconds by stage. What JAX spends on tracing, lowering and compiling (or on loading what it
compiled before) is told by its own monitoring events and taken out of the stage in which it fell; the rest of the fit
is `run`. Of spans one within the other the innermost counts.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

BEGIN = "ETCFIT_BENCH_BEGIN"  # in the environment: when this process was started, s since the epoch
EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lower",
    "/jax/core/compile/backend_compile_duration": "compile",
}
STAGES = ("import", "read", "trace", "lower", "compile", "run", "pictures")

Span = tuple[str, float, float]  # stage, begin, end


class Clock:
    """Spans of time by stage, seconds of compiling by program, and how often the Jacobian was computed."""

    def __init__(self) -> None:
        self.spans: list[Span] = []
        self.programs: dict[str, float] = defaultdict(float)
        self.jacobians: Counter[str] = Counter()

    def around(self, module: Any, name: str, stage: str) -> None:
        """Have calls of module.name timed."""
        plain = getattr(module, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            begin = time.time()
            try:
                return plain(*args, **kwargs)
            finally:
                self.spans.append((stage, begin, time.time()))

        setattr(module, name, timed)

    def heard(self, event: str, duration_secs: float, **kwargs: str | int) -> None:
        """A monitoring event of JAX, told as it ends."""
        if event in EVENTS:
            now = time.time()
            self.spans.append((EVENTS[event], now - duration_secs, now))
            self.programs[str(kwargs.get("fun_name", "?")).removeprefix("jit(").removesuffix(")")] += duration_secs

    def count(self, descent: Any, others: Iterable[Any]) -> None:
        """Have Jacobians counted: one a step of Levenberg-Marquardt, and one a linearisation.

        Args:
            descent: the module of the solver.
            others: modules that have imported its functions by name.
        """
        minimise, linearise_at = descent.minimise, descent.linearise_at

        def minimised(*args: Any, **kwargs: Any) -> Any:
            x, steps = minimise(*args, **kwargs)
            self.jacobians["steps"] += steps
            return x, steps

        def linearised(*args: Any, **kwargs: Any) -> Any:
            self.jacobians["besides"] += 1
            return linearise_at(*args, **kwargs)

        for module in (descent, *others):
            for name, counted in (("minimise", minimised), ("linearise_at", linearised)):
                if hasattr(module, name):
                    setattr(module, name, counted)


def shares(spans: list[Span], begin: float, end: float) -> dict[str, float]:
    """Seconds from `begin` to `end` by innermost span; `import` is what lies outside all of them."""
    edges = sorted({begin, end, *(t for _, a, b in spans for t in (a, b) if begin < t < end)})
    out: dict[str, float] = dict.fromkeys(STAGES, 0.0)
    for a, b in pairwise(edges):
        inside = [(last - first, stage) for stage, first, last in spans if first <= a and b <= last]
        out[min(inside)[1] if inside else "import"] += b - a
    return out


def measure(command: list[str], begin: float) -> dict[str, Any]:
    """Run the command line; what it took by stage since `begin`, s since the epoch."""
    import jax

    import etcfit.estimation.joint_fit
    import etcfit.reporting.pictures  # so that importing it counts as such
    from etcfit import reporting
    from etcfit.cli import app
    from etcfit.estimation import edges, free_run, levenberg_marquardt, rounds
    from etcfit.rig import reader

    clock = Clock()
    jax.monitoring.register_event_duration_secs_listener(clock.heard)
    clock.around(reader, "read_folder", "read")
    clock.around(etcfit.estimation.joint_fit, "fit", "run")
    clock.around(reporting, "draw_fit", "pictures")
    clock.count(levenberg_marquardt, (edges, free_run, rounds))
    app(command, standalone_mode=False)
    seconds = shares(clock.spans, begin, time.time())
    largest = sorted(clock.programs.items(), key=lambda item: -item[1])[:12]
    return {"seconds": seconds, "jacobians": clock.jacobians, "programs": dict(largest)}


def main() -> None:
    folder, run = sys.argv[1:3]
    begin = float(os.environ.get(BEGIN, time.time()))
    print(json.dumps(measure(["fit", folder, "--out", run, "--quiet"], begin)))


if __name__ == "__main__":
    main()
