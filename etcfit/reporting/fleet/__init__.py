"""What a person sees of a fleet: a table for the terminal, pictures, and RUN/fleet.html, all made from fleet.json and
units.parquet."""

from __future__ import annotations

from .page import write_fleet_page
from .table import fleet_table

__all__ = ["fleet_table", "write_fleet_page"]
