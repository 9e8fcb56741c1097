"""A name that is not likely enough to change anything because of it: what to measure is said instead."""

from __future__ import annotations


def is_suspicion(probability: float, limit: float) -> bool:
    """Whether a name's probability, given the data, is below the limit, `DiagnosisSettings.suspicion`."""
    return probability < limit


def what_would_tell(probability: float, told_by: str) -> str:
    """The words after a suspicion: how probable it is, and which measurement would tell (`told_by` of the effect)."""
    return f"This is a suspicion, with probability {probability:.2f}. What would tell: {told_by}."
