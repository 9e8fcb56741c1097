"""What the proposed gains do where something fails: jam, sensor, supply, current; and how that is told in time."""

from __future__ import annotations

from .figures import Safety as Safety
from .figures import safety as safety
from .holding import Holding as Holding
from .jam import Envelope as Envelope
from .jam import JamCheck as JamCheck
from .sags import Sag as Sag
from .sensor import Runaway as Runaway
from .spring_return import Return as Return
