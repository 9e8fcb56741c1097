"""What is probable enough for a word: one list for statements, terminal and pages."""

from __future__ import annotations

from collections.abc import Mapping

_WORTH_A_WORD = 0.02


def likely(probabilities: Mapping[str, float | None]) -> list[tuple[str, float]]:
    """Hypotheses with a probability worth a word, the likeliest first."""
    worth = ((name, p) for name, p in probabilities.items() if p and p >= _WORTH_A_WORD)
    return sorted(worth, key=lambda each: (each[1], each[0]), reverse=True)


def in_words(probabilities: Mapping[str, float | None]) -> str:
    """Those in one line, "" where there are none."""
    return ", ".join(f"{name} {p:.2f}" for name, p in likely(probabilities))
