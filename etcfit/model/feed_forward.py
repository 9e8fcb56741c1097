"""Feed-forward of an ECU: its terms by name."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from ..errors import UsageError


class Term(Enum):
    """A term of feed-forward.

    Args:
        SPRING: the voltage that holds the plate at the setpoint, a table over it.
        FRICTION: the voltage against dry friction while the plate slides, with the sign of the setpoint's rate.
        RATE: the voltage against back-EMF and viscous drag, in proportion to the setpoint's rate.
    """

    SPRING = "spring"
    FRICTION = "friction"
    RATE = "rate"


TermNames = bool | str | Iterable[str | Term]  # True is the spring's table alone, a string has names between commas


def terms_of(names: TermNames) -> tuple[Term, ...]:
    """The requested terms, each once, in the order of `Term`.

    Raises:
        UsageError: there is no such term.
    """
    if isinstance(names, bool):
        return (Term.SPRING,) if names else ()
    names = names.split(",") if isinstance(names, str) else names
    wanted = {each.value if isinstance(each, Term) else each.strip() for each in names}
    known = [term.value for term in Term]
    if unknown := sorted(wanted - set(known)):
        raise UsageError(f"{', '.join(unknown)}: no such term of feed-forward. Known: {', '.join(known)}.")
    return tuple(term for term in Term if term.value in wanted)


def as_recorded(terms: tuple[Term, ...]) -> bool | list[str]:
    """The requested terms for a manifest: True for the spring's table alone, False for none, else names."""
    return bool(terms) if terms in ((), (Term.SPRING,)) else listed(terms)


def listed(terms: Iterable[Term]) -> list[str]:
    """Their names."""
    return [term.value for term in terms]
