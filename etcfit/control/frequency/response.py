"""The frequency response that sine traces measure, beside what the fitted model and its linear plant say.

The ECU's gains need not be known: where its drive was logged, each trace shows C = drive / (setpoint - position), and a
plant P under that same ECU follows the setpoint as

    T = C P / (1 + C P).

With the measured P this is the measured T; with another one it is what the loop would do around that plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import MeasurementError
from ...estimation.fitted_model import Fitted
from ...model.linear import TransferFunction
from ...problem.problem import EstimationProblem
from ...problem.trace import prepare
from ...rig.base import Measurement
from ..linearise import reduce, stops
from ..settings import FrequencySettings
from .lag import Order, order_of
from .point import DRIVE, POSITION, Point, point_of
from .wave import Ratio, Signal, fundamental

_LEAD = np.pi / 2.0  # rad: what leads by more than this at the lowest frequency is taken to lag


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Sine traces, measured and modelled.

    Args:
        points: in order of frequency.
        order: of lag from setpoint to position.
        plant_order: of lag from drive to position; None where no drive was logged.
        nonlinear: position over drive of the fitted model, run free on each point's drive, rad/V; None without one.
        linear: the linear plant about the middle of the sines, rad/V.
        share: of the travel at that operating point.
        warnings: which traces say nothing, and why.
        settings: what it was decided by.
    """

    points: tuple[Point, ...]
    order: Order
    plant_order: Order | None
    nonlinear: tuple[complex | None, ...]
    linear: TransferFunction
    share: float
    warnings: tuple[str, ...]
    settings: FrequencySettings = FrequencySettings()

    @property
    def frequencies(self) -> np.ndarray:
        """Hz."""
        return np.array([point.frequency for point in self.points])

    @property
    def plants(self) -> tuple[Ratio | None, ...]:
        """Position over drive as measured, rad/V; None where no drive was logged."""
        return tuple(point.plant for point in self.points)

    @property
    def linear_plant(self) -> tuple[complex, ...]:
        """The linear plant at each point, rad/V."""
        return tuple(np.asarray(self.linear(2j * np.pi * self.frequencies), dtype=complex).tolist())

    def loops_around(self, plants: Sequence[complex | None]) -> tuple[complex | None, ...]:
        """Position over setpoint at each point, were this the plant under the ECU; None where its drive is not known.

        C P / (1 + C P)
        """
        ecus = [point.controller for point in self.points]
        return tuple(
            None if ecu is None or plant is None else ecu.value * plant / (1.0 + ecu.value * plant)
            for ecu, plant in zip(ecus, plants, strict=True)
        )


def frequency_response(
    fitted: Fitted, traces: Sequence[Measurement], settings: FrequencySettings = FrequencySettings()
) -> FrequencyResponse:
    """Fit a sine to every trace, and one of its frequency to the model's free run on that trace's drive.

    Args:
        fitted: the model.
        traces: of the sine test.
        settings: which traces count, and when their points tell an order of lag.
    """
    points, warnings = _points(fitted, traces, settings)
    lower, upper = stops(fitted)
    middle = float(np.median([point.waves.offsets[POSITION] for point in points])) if points else lower
    share = float(np.clip((middle - lower) / (upper - lower), 0.0, 1.0))
    driven = [(point.frequency, ratio) for point in points if (ratio := point.plant) is not None]
    return FrequencyResponse(
        points,
        _order([(point.frequency, point.closed_loop) for point in points], settings),
        _order(driven, settings) if driven else None,
        _free_runs(fitted, points),
        reduce(fitted, share=share).plant,
        share,
        warnings,
        settings,
    )


def phases(values: Sequence[complex | None]) -> np.ndarray:
    """Phases in order of frequency, rad, nan for None.

    The first lies between -270 and 90 degrees, each of the others within 180 of the one before.
    """
    angles = np.array([np.nan if value is None else np.angle(value) for value in values])
    there = np.flatnonzero(np.isfinite(angles))
    angles[there] = np.unwrap(angles[there])
    return angles - 2.0 * np.pi if there.size and angles[there[0]] > _LEAD else angles


def _points(
    fitted: Fitted, traces: Sequence[Measurement], settings: FrequencySettings
) -> tuple[tuple[Point, ...], tuple[str, ...]]:
    points, warnings = [], []
    for trace in traces:
        try:
            points.append(point_of(trace, fitted.config, settings))
        except MeasurementError as error:
            warnings.append(str(error))
    return tuple(sorted(points, key=lambda point: point.frequency)), tuple(warnings)


def _order(measured: Sequence[tuple[float, Ratio]], settings: FrequencySettings) -> Order:
    return order_of(np.array([frequency for frequency, _ in measured]), [ratio for _, ratio in measured], settings)


def _free_runs(fitted: Fitted, points: Sequence[Point]) -> tuple[complex | None, ...]:
    """The model's position over the measured drive at each point; None where no drive was logged."""
    driven = [point for point in points if point.plant is not None]
    ready = [prepare(point.measurement, fitted.config) for point in driven]
    traces = tuple(trace for trace in ready if trace is not None)
    if not traces:
        return (None,) * len(points)
    runs = EstimationProblem.of(fitted.config, fitted.free_parameters, traces).refined(fitted.x).free_run(fitted.x)
    of_file = {
        trace.measurement.file: Signal(trace.instants, run[:, trace.channels.index(POSITION)])
        for trace, run in zip(traces, runs, strict=True)
    }
    return tuple(_described(point, of_file.get(point.measurement.file)) for point in points)


def _described(point: Point, position: Signal | None) -> complex | None:
    """A simulated position's fundamental over that of the measured drive, in the part of the trace that counts."""
    if position is None or not np.all(np.isfinite(position.value)):
        return None
    part, waves = position.between(point.window.begin, point.window.end), point.waves
    return fundamental(part, point.frequency, waves.middle, waves.harmonics) / complex(waves.amplitudes[DRIVE][0])
