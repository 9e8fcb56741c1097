"""What a notebook holds: the verbs of the command line as functions, and what they return as tables and pictures.

No numerics of its own. Every object here wraps what an earlier room computed, as `result`, `diagnosis`, `posterior`,
`reduction` or `design`, and shows it: as a DataFrame, as matplotlib Axes, in a few lines, or as a small table.
"""

from __future__ import annotations
