"""Work for processes of which one dies, for the test of what the bank does then."""

from __future__ import annotations

import os
import signal
from typing import Any

from benchmarks.bank.cases import Case
from benchmarks.bank.records import blank

FATAL = 6514


def work(chosen: Case) -> dict[str, Any]:
    """An empty record; one seed ends the process."""
    if chosen.seed == FATAL:
        os.kill(os.getpid(), signal.SIGKILL)
    return blank(chosen, {})
