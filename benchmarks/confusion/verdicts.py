"""What one record says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

NEAR = 1.2  # held-out error over noise within which a model predicts what it has not seen
LIKELY = 0.5  # probability above which a hypothesis is said to hold
Record = dict[str, Any]


def tied(record: Record, name: str) -> set[str]:
    """A name found, and what these data cannot tell from it."""
    return {name}.union(*(tie for tie in record["ties"] if name in tie))


def first(record: Record) -> str:
    """What was named first, "-" for nothing; of an effect of the rig without its place."""
    return record["added"][0].partition("[")[0] if record["added"] else "-"


def is_first(record: Record) -> bool:
    """What is there was named first, or is tied with what was."""
    return bool(record["added"]) and record["names"][0] in tied(record, record["added"][0])


def counted(records: Sequence[Record]) -> Counter[tuple[str, str]]:
    """How often which was named first where which was there, "clean" for nothing; pairs are left out."""
    alone = of_kind(records, "clean", "single", "outside")
    return Counter((r["names"][0] if r["names"] else "clean", first(r)) for r in alone)


def is_found(record: Record, name: str) -> bool:
    """By its name, or in a tie."""
    return any(name in tied(record, added) for added in record["added"])


def of_kind(records: Sequence[Record], *kinds: str) -> list[Record]:
    return [r for r in records if r["kind"] in kinds]


def said(record: Record) -> str:
    """What was named, with its ties, and what stayed unexplained."""
    named = " + ".join("=".join((name, *sorted(tied(record, name) - {name}))) for name in record["added"]) or "nothing"
    left = record["unexplained"]
    return named if left is None else f"{named}, and {left['enters']} over {left['depends_on']}"


def wholly_found(record: Record) -> bool:
    """Everything that is in the folder."""
    return all(is_found(record, name) for name in record["names"])


def says_unexplained(record: Record) -> bool:
    """It says that something is left which has no name: by a curve, or, since it states probabilities, as likelier than
    not, for what is left need not be a function of one quantity."""
    curve = record["unexplained"] is not None
    return curve or record.get("probabilities", {}).get("unexplained", 0.0) > LIKELY


def is_silent(record: Record) -> bool:
    """Nothing named, nothing unexplained."""
    return record["added"] == [] and not says_unexplained(record)


def is_open(record: Record) -> bool:
    """Nothing named, but called unexplained."""
    return record["added"] == [] and says_unexplained(record)


def is_clear(record: Record) -> bool:
    """What is in the folder is of medium or high strength."""
    return "low" not in record["strength"]


def has_no_other(record: Record) -> bool:
    """Nothing named that is not there."""
    return all(tied(record, name) & set(record["names"]) for name in record["added"])


def is_true(record: Record, hypothesis: str) -> bool:
    """Whether an effect is in the folder; "nothing": nothing but what is faint, "unexplained": from outside the
    catalogue and not faint."""
    if hypothesis == "nothing":
        return set(record["strength"]) <= {"low"}
    if hypothesis == "unexplained":
        return record["kind"] == "outside" and is_clear(record)
    return hypothesis in record["names"]


def sure(records: Sequence[Record], when: str) -> list[Record]:
    """Every parameter that was given a 95 % interval; `when` is "before" or "after"."""
    each = (p for r in records for p in r[when]["parameters"].values())
    return [p for p in each if p["low"] is not None and p["stderr"]]


def stated(records: Sequence[Record], when: str) -> list[bool]:
    """Of every 95 % interval whether it holds the truth."""
    return [p["low"] <= p["truth"] <= p["high"] for p in sure(records, when)]


def over_least(record: Record) -> float:
    """Held-out error of the position after the loop over what the body itself leaves."""
    return record["after"]["holdout_position"] / least_left(record, ("position",))


def least_left(record: Record, channels: Sequence[str]) -> float:
    """Error over noise that the body itself leaves of these channels of the held-out traces, pooled as a model's is."""
    samples = {(file, channel): n for file, channel, n, _ in record["after"]["holdout_rows"]}
    left = [(samples[file, channel], ratio) for file, channel, ratio in record["by_itself"] if channel in channels]
    count, ratio = np.array(left).T
    return float(np.sqrt(np.sum(count * ratio**2) / count.sum()))
