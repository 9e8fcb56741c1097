"""Frequency response of loop and plant from sine traces, and the order of lag that it shows."""

from __future__ import annotations

from .lag import Lag, Order
from .response import FrequencyResponse, Point, frequency_response, phases
from .wave import Ratio

__all__ = ["FrequencyResponse", "Lag", "Order", "Point", "Ratio", "frequency_response", "phases"]
