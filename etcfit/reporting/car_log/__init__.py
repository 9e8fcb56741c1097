"""What `etcfit drive` shows of logs from the car: tables for a terminal, a page, pictures, drive.json."""

from __future__ import annotations

from .tables import drive_table as drive_table
