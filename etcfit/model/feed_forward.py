"""What an ECU may put out ahead of its PID: the terms of its feed-forward, by name."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from ..errors import UsageError


class Term(Enum):
    """A term of feed-forward.

    Args:
        SPRING: the voltage that holds the plate at the setpoint, a table over it.
        FRICTION: what dry friction takes while the plate slides, with the sign of the setpoint's rate.
        RATE: what back-EMF and viscous drag take, in proportion to the setpoint's rate.
    """

    SPRING = "spring"
    FRICTION = "friction"
    RATE = "rate"


Asked = bool | str | Iterable[str | Term]  # True is the spring's table alone, a string has names between commas


def terms_of(asked: Asked) -> tuple[Term, ...]:
    """The terms that are asked for, each once, in the order in which they are listed.

    Raises:
        UsageError: a name is none of them.
    """
    if isinstance(asked, bool):
        return (Term.SPRING,) if asked else ()
    names = asked.split(",") if isinstance(asked, str) else asked
    wanted = {each.value if isinstance(each, Term) else each.strip() for each in names}
    known = [term.value for term in Term]
    if unknown := sorted(wanted - set(known)):
        raise UsageError(f"{', '.join(unknown)}: no such term of feed-forward. Known: {', '.join(known)}.")
    return tuple(term for term in Term if term.value in wanted)


def as_asked(terms: tuple[Term, ...]) -> bool | list[str]:
    """How a manifest keeps what was asked for: yes or no where it is the spring's table or nothing, else names."""
    return bool(terms) if terms in ((), (Term.SPRING,)) else listed(terms)


def listed(terms: Iterable[Term]) -> list[str]:
    """Their names."""
    return [term.value for term in terms]
