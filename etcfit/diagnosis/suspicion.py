"""A name that is not likely enough to change anything because of it: what to measure is said instead."""

from __future__ import annotations

from .settings import DiagnosisSettings


def is_suspicion(probability: float, settings: DiagnosisSettings) -> bool:
    """Whether a name's probability, given the data, is below `DiagnosisSettings.suspicion`."""
    return probability < settings.suspicion


def what_would_tell(probability: float, told_by: str) -> str:
    """The words after a suspicion: how probable it is, and which measurement would tell (`told_by` of the effect)."""
    return f"This is a suspicion, with probability {probability:.2f}. What would tell: {told_by}."
