"""For notebooks: the commands of the command line as functions, and their results as tables and pictures.

This room computes nothing itself. Every object here wraps a result of an earlier room (`result`, `diagnosis`,
`posterior`, `reduction` or `design`) and shows it as a DataFrame, as matplotlib Axes, in a few lines, or as a small
table.
"""

from __future__ import annotations
