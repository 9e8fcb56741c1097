"""Back-EMF test: terminals open, plate let go from open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from .base import AbstractRigTest, Boundary, Channel, Graph, Measurement, Reading, RigConfig
from .signals import motion, off_stops, robust_slope, smoothing_window


def constant(emf: float, plate_speed: float, N: float) -> float:
    """K_b = e_b/(N omega_L), V s/rad (Eq. 4)."""
    return emf / (N * plate_speed)


def emf_of(trace: Measurement) -> Channel | None:
    """The EMF; with open terminals a logged terminal voltage is the EMF."""
    return trace.channels.get("emf", trace.channels.get("voltage"))


def fast_part(trace: Measurement, config: RigConfig) -> tuple[np.ndarray, np.ndarray]:
    """Speed (rad/s) and EMF (V), equally smoothed, where the plate is off its stops and above 60 % of its top speed."""
    emf, position = emf_of(trace), trace.channels.get("position")
    moved = None if emf is None or position is None else motion(position, smoothing_window(position))
    if emf is None or position is None or moved is None:
        return np.empty(0), np.empty(0)
    free = off_stops(moved.angle, config, position.sigma) & (moved.time >= emf.time[0]) & (moved.time <= emf.time[-1])
    # half a window next to a stop mixes rest into the slope
    inner = np.convolve(free, np.ones(moved.window), "same") >= moved.window - 0.5
    used = inner if inner.sum() >= 3 else free
    top = np.max(np.abs(moved.speed[used]), initial=0.0)
    used = used & (np.abs(moved.speed) > 0.6 * top)
    return moved.speed[used], moved.smooth(emf)[used]


@final
class BackEmf(AbstractRigTest):
    """With open terminals e_b = K_b N omega_L; the return spring moves the plate."""

    name = "back_emf"
    title = "Back electromotive force test"
    boundary = Boundary(terminals_open=True, released=True)
    drives = ()
    observes = ("emf", "position")
    needs = (("emf", "voltage"), ("position",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """Slope of e_b over omega_L where the plate is fast (Eq. 4, Fig. 13), over the gear ratio."""
        parts = [fast_part(trace, config) for trace in traces]
        speed, emf = (np.concatenate([p[k] for p in parts]) if parts else np.empty(0) for k in (0, 1))
        if len(speed) < 3:
            return Reading({}, notes=("K_b cannot be read: no EMF of a moving plate",))
        ratio = robust_slope(speed, emf)
        notes = () if ratio > 0 else ("EMF and position run against each other: its poles were swapped",)
        K_b = constant(abs(ratio), 1.0, known["N"])
        ends = np.array([0.0, speed[np.argmax(np.abs(speed))]])
        graph = Graph(self.title, "plate speed [rad/s]", "EMF [V]", speed, emf, ends, ratio * ends,
                      f"slope {abs(ratio):.4g} V s/rad at the plate: K_b = {K_b:.4g} V s/rad")  # fmt: skip
        return Reading({"K_b": K_b}, (graph,), notes)
