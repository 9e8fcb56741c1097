"""PLAN/procedure.html: what a person at the bench needs of a plan, on paper."""

from __future__ import annotations

from .page import write_sheet
from .table import plan_table

__all__ = ["plan_table", "write_sheet"]
