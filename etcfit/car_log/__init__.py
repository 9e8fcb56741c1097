"""Logs from the car: where, how fast and how closely the plate moves, and whether that is good enough; no model.

Source: the paper, Sections 2 and 4.3.

The reader of files (`read`) loads every format of `importing`, so it is imported by its own name: every fit imports
this package for its thresholds.
"""

from __future__ import annotations

from .coverage import Lack as Lack
from .coverage import record_next as record_next
from .log import DriveLog as DriveLog
from .log import Series as Series
from .study import Study as Study
from .study import study as study
from .tracking import Tracking as Tracking
from .tracking import tracking as tracking
from .usage import Spectrum as Spectrum
from .usage import Usage as Usage
from .usage import spectrum as spectrum
from .usage import usage as usage
