"""Gains, limits and bias table as a TunerStudio tune file (.msq) that holds nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

from ... import __version__
from ...errors import MeasurementError, UsageError
from ...files import read_regular
from ...model.ecus import PROFILES, Pasting
from ...model.ecus import named as ecu_named
from ...reporting.control.snippet import tune_file
from ..base import Export, Format, Source
from ..rendering import comment

_NAMESPACE = "http://www.msefi.com/:msq"  # of TunerStudio's files
_CONSTANT = re.compile(r"<constant(?P<attributes>\s[^<>]*)>(?P<value>[^<]*)</constant>")
_NO_SETTINGS = (("<!--", "-->"), ("<![CDATA[", "]]>"))  # what a tune may hold besides
_WITH_TUNE_FILES = ", ".join(each.name for each in PROFILES if each.pasting is Pasting.TUNE_FILE)


def _written(source: Source) -> Mapping[str, Any]:
    """Settings of the ECU that the gains were sought for.

    Raises:
        UsageError: there are none, that ECU has no tune file, or the model behind them is no estimate.
    """
    again = f"Run `{source.designing} --ecu NAME` with one of {_WITH_TUNE_FILES}."
    if source.pid is None:
        raise UsageError(f"A .msq holds gains, and none were designed for this model. {again}")
    written = source.pid["profile"]
    if written is None:
        raise UsageError(f"The gains of this run were sought for no make of ECU, and a .msq is one's tune. {again}")
    if ecu_named(written["name"]).pasting is not Pasting.TUNE_FILE:
        raise UsageError(f"The gains of this run are for {written['title']}, whose settings are typed in; a .msq is "
                         f"TunerStudio's. {again}")  # fmt: skip
    if (cautions := source.fitted.state.cautions) and not source.anyway:
        raise UsageError(f"{' '.join(cautions)} No tune is written with gains of it. Run `etcfit diagnose`, then "
                         f"`{source.designing}`; --anyway (Python: anyway=True) writes it all the same.")  # fmt: skip
    return written


def _cannot_hold(source: Source, written: Mapping[str, Any]) -> Iterator[str]:
    if source.into is None:
        yield ("It holds these settings only and not your firmware's signature, so that TunerStudio will say that the "
               "signatures do not match.")  # fmt: skip
        # no option as it is typed: a comment of XML must not hold two hyphens
        yield "Given your own tune (the option into), etcfit changes a copy of that instead."
    yield "Keep your old tune, and compare before you burn."
    yield f"The gains are for {written['title']}. Another firmware may give the same names another meaning."
    yield from (f"Assumed of that ECU: {each}." for each in written["assumed"])
    jam = ((source.pid or {}).get("safety") or {}).get("jam") or {}
    for name, value in (jam.get("written") or {}).items():
        yield f"The jam check is typed in by hand: {name} {value:g}."
    if source.pid is not None and not source.pid["feed_forward"] and written["bias"] is not None:
        yield "The gains were found without feed-forward: the bias table is all 0."


def _export(source: Source) -> Export:
    written = _written(source)
    lost = (*source.cautions, *_cannot_hold(source, written))
    if source.into is None:
        return Export({f"etcfit_{written['name']}.msq": _new(source, written, lost)}, lost)
    return Export({f"{source.into.stem}_etcfit.msq": _changed(source, source.into, written, lost)}, lost)


def _new(source: Source, written: Mapping[str, Any], lost: tuple[str, ...]) -> bytes:
    """A tune of these settings alone."""
    root = Xml.Element("msq", {"xmlns": _NAMESPACE})
    Xml.SubElement(root, "bibliography", {"author": f"etcfit {__version__}", "tuneComment": source.title})
    Xml.SubElement(root, "versionInfo", {"fileFormat": "5.0", "nPages": "1", "signature": written["title"]})
    page = Xml.SubElement(root, "page", {"number": "0"})
    page.extend(Xml.fromstring("<page>" + "\n".join(tune_file(written)) + "</page>"))
    Xml.indent(page, level=1)
    notes = comment((source.title, source.origin, *lost), "  ")
    text = Xml.tostring(root, encoding="unicode").replace("><", ">\n<")
    head = f'<?xml version="1.0" encoding="ISO-8859-1"?>\n<!--\n{notes}\n-->\n'
    # as TunerStudio reads it; what Latin-1 lacks becomes a reference
    return (head + text + "\n").encode("iso-8859-1", "xmlcharrefreplace")


def _changed(source: Source, path: Path, written: Mapping[str, Any], lost: tuple[str, ...]) -> bytes:
    """A copy of a tune in which nothing but these settings has changed.

    Raises:
        MeasurementError: it is no tune, or one whose firmware has no such settings.
    """
    text = read_regular(path, str(path)).decode("iso-8859-1")
    if f'xmlns="{_NAMESPACE}"' not in text:
        raise MeasurementError(str(path), "it is no tune of TunerStudio.", f"A .msq of {written['title']} is required.",
                               "Save one in TunerStudio: File, Save Tune As.")  # fmt: skip
    for ours in Xml.fromstring("<page>" + "\n".join(tune_file(written)) + "</page>"):
        text = _replaced(path, text, ours.attrib["name"], ours, written["title"])
    notes = comment((source.title, source.origin, *lost), "  ")
    return text.replace("</msq>", f"<!--\n{notes}\n-->\n</msq>").encode("iso-8859-1", "xmlcharrefreplace")


def _replaced(path: Path, text: str, name: str, ours: Xml.Element, title: str) -> str:
    """The text of a tune with one setting replaced, its attributes as they stand there."""
    found = [each for each in _settings(text) if f'name="{name}"' in each["attributes"].split()]
    rows = ours.attrib.get("rows")
    if len(found) != 1 or (rows is not None and f'rows="{rows}"' not in found[0]["attributes"]):
        asked = f"{name} with {rows} rows" if rows else name
        raise MeasurementError(str(path), f"no setting {asked} in it.", f"A tune of {title} is required.",
                               "Name one of the firmware that runs on your ECU.")  # fmt: skip
    value = ours.text or ""
    if rows:
        value = "".join(f"\n         {each}" for each in value.split()) + "\n      "
    return f"{text[: found[0].start('value')]}{value}{text[found[0].end('value') :]}"


def _settings(text: str) -> Iterator[re.Match[str]]:
    """Every setting of a tune that is no comment, in one pass: a pattern over the whole text may search for hours."""
    at = 0
    while (at := text.find("<", at)) >= 0:
        if end := next((end for begin, end in _NO_SETTINGS if text.startswith(begin, at)), ""):
            closed = text.find(end, at + 4)
            at = closed if closed >= 0 else len(text)
        elif found := _CONSTANT.match(text, at):
            yield found
            at = found.end()
        else:
            at += 1


FORMAT = Format("msq", "gains and bias table for TunerStudio (rusEFI, FOME)", _export, changes=True)
