"""How straight the position sensor is."""

from __future__ import annotations

import numpy as np

from ...model.effects import Inputs, State
from ...model.effects.position_sensor_nonlinearity import PositionSensorNonlinearity
from .base import AbstractFigure, FigureResult
from .station import Station

_PLACES = 401


class SensorLinearity(AbstractFigure):
    """max |reading - angle| over the travel, of a sensor calibrated at the stops."""

    name = "sensor_linearity"
    unit = "rad"
    meaning = "largest deviation of the position sensor from the line through the stops"
    source = "Fraden 2016, terminal points"

    def of(self, station: Station) -> FigureResult:
        effects = station.throttles.effects
        bent = next((each for each in effects if isinstance(each, PositionSensorNonlinearity)), None)
        if bent is None:
            return FigureResult(
                np.full(station.count, np.nan), "not modelled: the model has no position_sensor_nonlinearity"
            )
        angles = np.linspace(station.body.lower, station.body.upper, _PLACES)
        u = Inputs(0.0, 0.0, 0.0, 1.0, 0.0, *station.body)
        off = [np.asarray(bent(State(0.0, theta, 0.0), (), u).position) for theta in angles]
        return FigureResult(np.max(np.abs(off), axis=0))
