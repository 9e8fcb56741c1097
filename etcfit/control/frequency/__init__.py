"""What sine traces say of the loop and of the plant in it: response by frequency, order of lag."""

from __future__ import annotations

from .lag import Lag, Order
from .response import FrequencyResponse, Point, frequency_response, phases
from .wave import Ratio

__all__ = ["FrequencyResponse", "Lag", "Order", "Point", "Ratio", "frequency_response", "phases"]
