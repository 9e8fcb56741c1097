"""The three lines at the end of every command: the answer in words, where to look, what to type next."""

from __future__ import annotations

from .base import Closing as Closing
