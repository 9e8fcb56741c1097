"""What `etcfit drive` shows of logs from the car: tables for a terminal, a page, pictures, drive.json."""

from __future__ import annotations

from .pictures import draw as draw
from .terminal import drive_table as drive_table
from .writing import write_drive as write_drive
