"""What logs from the car lack, for the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def to_record(logs: Mapping[str, Any]) -> list[str]:
    """A line for each log to record next; none where drive.json is older than that."""
    return [f"Record next: {each['record']}. It tells {each['why']}." for each in logs.get("record_next") or ()]
