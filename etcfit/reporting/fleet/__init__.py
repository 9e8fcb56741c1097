"""What a person sees of a fleet: a table for the terminal, pictures, and RUN/fleet.html, all made from fleet.json and
units.parquet."""

from __future__ import annotations

from .page import write_fleet_page
from .pictures import draw_fleet
from .table import fleet_table

__all__ = ["draw_fleet", "fleet_table", "write_fleet_page"]
