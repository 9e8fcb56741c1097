"""What one record says, and whether that is right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

Record = dict[str, Any]  # one line of the file, see `records.one`

LIKELY = 0.5  # probability above which something is said to hold
SURE = 0.8  # probability from which on a wrong name does harm: it is mended in rig.toml
Z_95 = 1.959963984540054
FAR = 5.0  # standard errors that no interval may be off
ALSO = {"voltage": "current", "current": "voltage"}  # what reads one too large reads the other too small
# effects that are a habit of the rig as well, and rightly named by its checks
HABITS = {"current_sensor_offset": "channel_offset", "actuation_delay": "synchronous_edges"}
# what became of a folder, worst first
GRADES = ("failed", "wrong name, sure", "wrong name", "missed", "partly", "called unexplained", "right")


def is_right(truth: dict[str, Any], name: dict[str, Any]) -> bool:
    """Whether a name is of something that is there: an effect by its name, a mistake of the rig by kind and place.

    A name that these data cannot tell from it counts as it does.

    Args:
        truth: of the record.
        name: one of its names; a tie in `ties` has the same keys.
    """
    return any(_is(truth, each) for each in (name, *name.get("ties", ())))


def _is(truth: dict[str, Any], name: dict[str, Any]) -> bool:
    made = truth["mistake"]
    if not made:
        return name["name"] in truth["names"] or (bool(truth["edges"]) and name["kind"] == "edge_phase")
    if name.get("before_any_fit"):  # physics rules the data out; the message names the kind
        return name["kind"] == made["kind"]
    kind, test, file, channel = (made[key] for key in ("kind", "test", "file", "channel"))
    place = (name.get("test") or "") in ("", test or "") and (name.get("file") or "") == file
    also = "" if kind == "channel_late" else ALSO.get(channel or "")
    of_channel = channel in (None, "time") or (name.get("channel") or "") in ("", channel, also)
    return kind in (name["kind"], name.get("called")) and place and of_channel


def is_faint(record: Record) -> bool:
    """Nothing is in the folder that must show."""
    return not record["truth"]["mistake"] and set(record["truth"]["strength"]) <= {"low"}


def is_true(record: Record, hypothesis: str) -> bool | None:
    """Of "nothing" and "unexplained": "nothing" is that nothing is missing but what is faint, "unexplained" that
    something is which the catalogue has not; None where neither is asked, for the log itself is too slow."""
    if record["class"] == "slow":
        return None
    if hypothesis == "nothing":
        return is_faint(record)
    return record["class"] == "outside" and not is_faint(record)


def wrong(record: Record, least: float = 0.0) -> list[str]:
    """Names of what is not there, stated with at least this probability."""
    return [n["name"] for n in record["named"] if not n["right"] and n["probability"] >= least]


def found(record: Record) -> list[str]:
    """Of what is there and has a name in the catalogue, what was named."""
    named = [n for n in record["named"] if n["right"]]
    if record["truth"]["mistake"]:
        return record["truth"]["names"] if named else []
    said = {name["name"] for n in named for name in (n, *n["ties"])}
    return [name for name in record["truth"]["names"] if name in said]


def wanted(record: Record) -> list[str]:
    """What is there and must be named."""
    return [] if record["class"] in ("outside", "ecu") or is_faint(record) else record["truth"]["names"]


def says_unexplained(record: Record) -> bool:
    """By a curve, or as likelier than not."""
    return record["curve"] is not None or (record["unexplained"] or 0.0) > LIKELY


def grade(record: Record) -> str:
    """What became of the folder, one of GRADES."""
    if "error" in record:
        return "failed"
    if wrong(record):
        return "wrong name, sure" if wrong(record, SURE) else "wrong name"
    must, there = wanted(record), found(record)
    if len(there) < len(must):
        return "partly" if there else "missed"
    if record["class"] == "ecu":
        return "partly" if record["compromise"] or record["scale_told"] else "right"
    if is_faint(record) and record["class"] != "slow" and not there and says_unexplained(record):
        return "called unexplained"
    return "right"


def errors(record: Record, when: str = "after") -> dict[str, float]:
    """z of every parameter that was given a standard error; `when` is "before" or "after" the diagnosis."""
    stated = record.get("intervals", {}).get(when, {})
    return {symbol: each["z"] for symbol, each in stated.items() if each["z"] is not None}


def hold(records: Sequence[Record], when: str = "after") -> list[bool]:
    """Of every 95 % interval whether it holds the truth."""
    return [each["holds"] for r in records for each in _stated(r, when)]


def _stated(record: Record, when: str) -> Iterator[dict[str, Any]]:
    every = record.get("intervals", {}).get(when, {}).values()
    return (each for each in every if each["z"] is not None)


def worst(records: Sequence[Record], when: str = "after") -> tuple[float, str]:
    """The largest |z|, and whose."""
    every = [(abs(z), f"{symbol}, seed {r['seed']}") for r in records for symbol, z in errors(r, when).items()]
    return max(every, default=(0.0, "-"))


def missed(record: Record) -> int:
    """Intervals that do not hold the truth."""
    return int(np.sum(~np.array(hold([record]), dtype=bool)))


def title(record: Record) -> str:
    """Class, seed and what is in it, for a line."""
    truth = record["truth"]
    levels = truth["strength"] or [""] * len(truth["names"])
    there = " + ".join(f"{n} ({s})" if s else n for n, s in zip(truth["names"], levels, strict=True))
    made = truth["mistake"]
    where = f" in {made['file'] or made['test'] or 'the rig'}" if made else ""
    edges = f" {truth['edges']}" if truth["edges"] else ""
    return f"{record['class']}{edges} {record['seed']}: {there or 'nothing'}{where}"


def said(record: Record) -> str:
    """What came out."""
    if "error" in record:
        return record["error"]
    named = ", ".join(f"{n['name']} {n['probability']:.2f}" for n in record["named"])
    refused = "refused: " if record["check"]["refused"] else ""
    left = f", unexplained {record['unexplained']:.2f}" if record["unexplained"] is not None else ""
    z, whose = worst([record])
    sure = f"; worst |z| {z:.1f} ({whose.partition(',')[0]})" if errors(record) else "; no interval"
    return f"{refused}{named or 'no name'}{left}{sure}"
