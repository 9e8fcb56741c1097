"""Gains, limits and bias table as a TunerStudio tune file (.msq) with no other settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as Xml
from xml.parsers import expat

from .. import __version__
from ..errors import MeasurementError, UsageError
from ..files import read_regular
from ..model.ecu import BiasPoints
from ..model.ecus import PROFILES, EcuProfile, Pasting
from ..model.ecus import named as ecu_named
from ..reporting.control.gains import constants
from ..rig.user_text import one_line, xml_comment
from .base import Export, Format, Source

_NAMESPACE = "http://www.msefi.com/:msq"  # namespace of TunerStudio's files
_WITH_TUNE_FILES = ", ".join(each.name for each in PROFILES if each.pasting is Pasting.TUNE_FILE)


def _written(source: Source) -> Mapping[str, Any]:
    """Settings of the ECU for which the gains were designed."""
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
    """A tune with only these settings."""
    root = Xml.Element("msq", {"xmlns": _NAMESPACE})
    root.append(_comment(source, lost))
    about = {"author": f"etcfit {__version__}", "tuneComment": one_line(source.title)}
    Xml.SubElement(root, "bibliography", about)
    Xml.SubElement(root, "versionInfo", {"fileFormat": "5.0", "nPages": "1", "signature": one_line(written["title"])})
    Xml.SubElement(root, "page", {"number": "0"}).extend(constants(written))
    Xml.indent(root)
    head = '<?xml version="1.0" encoding="ISO-8859-1"?>\n'
    # in TunerStudio's form; characters that Latin-1 lacks become references
    return f"{head}{Xml.tostring(root, 'unicode')}\n".encode("iso-8859-1", "xmlcharrefreplace")


def _comment(source: Source, lost: tuple[str, ...]) -> Any:
    return Xml.Comment(xml_comment((source.title, source.origin, *lost)))


class _Setting(NamedTuple):
    """A setting of a tune: attributes of its tag; begin and end of its content, bytes."""

    attributes: Mapping[str, str]
    begin: int
    end: int


def _changed(source: Source, path: Path, written: Mapping[str, Any], lost: tuple[str, ...]) -> bytes:
    """A copy of a tune in which only these settings are changed, byte for byte."""
    data, title = read_regular(path, str(path)), written["title"]
    settings, end = _read(path, data, title)
    # only ASCII, which all encodings of a tune share
    note = Xml.tostring(_comment(source, lost), "unicode").encode("ascii", "xmlcharrefreplace")
    new = [(end, end, note + b"\n")]
    for ours in constants(written):
        place = _place(path, settings, ours.attrib, title)
        new.append((place.begin, place.end, _content(ours).encode("ascii")))
    for begin, finish, content in sorted(new, reverse=True):
        data = data[:begin] + content + data[finish:]
    return data


class OwnTune(NamedTuple):
    """Settings of the loop in a user's own tune."""

    file: str
    gains: tuple[float, float, float]  # P, I and D in the ECU's own numbers
    bias: BiasPoints  # its bias table, % of the travel and % of duty; () if it is all 0, or the make has none
    integral: float | None  # limit of its integral, a share of the supply; None if not given


_INTEGRAL = ("etb_iTermMin", "etb_iTermMax")  # %


def read_tune(path: Path, profile: EcuProfile) -> OwnTune:
    """Gains, bias table and limit of the integral of a tune.

    Raises:
        UsageError: this make of ECU has no tune file.
        MeasurementError: the file is no tune, lacks these settings, or a setting of it is no number.
    """
    if profile.pasting is not Pasting.TUNE_FILE:
        raise UsageError(f"{profile.title} has no tune file of TunerStudio ({_WITH_TUNE_FILES} have). Type the gains: "
                         "--present P,I,D.")  # fmt: skip
    data = read_regular(path, str(path))
    settings, _ = _read(path, data, profile.title)

    def numbers(name: str, rows: Mapping[str, str]) -> list[float]:
        place = _place(path, settings, {"name": name, **rows}, profile.title)
        text = data[place.begin : place.end].decode("ascii", "replace").strip().strip('"')
        try:
            return [float(word) for word in text.split()] if rows else [float(text)]
        except ValueError:
            raise MeasurementError(f"{path}: {name}", f"found '{text[:40]}'.", "A number is required.",
                                   "Save the tune again in TunerStudio.") from None  # fmt: skip

    p, i, d = (numbers(name, {})[0] for name in profile.gains)
    names, table = {each.attributes.get("name") for each in settings}, profile.bias
    bias, integral = dict[float, float](), None
    if table is not None and table.bins in names:
        rows = {"rows": str(table.points)}
        bias = dict(zip(numbers(table.bins, rows), numbers(table.values, rows), strict=False))  # unused points repeat
    if names.issuperset(_INTEGRAL):
        low, high = (numbers(name, {})[0] for name in _INTEGRAL)
        if low != -high or high <= 0.0:
            raise MeasurementError(f"{path}: {_INTEGRAL[0]}", f"found {low:g}, and {high:g} as {_INTEGRAL[1]}.",
                                   "One limit in both directions is required.",
                                   "Give the gains by --present instead; etcfit knows no other limit.")  # fmt: skip
        integral = 0.01 * high
    return OwnTune(str(path), (p, i, d), tuple(sorted(bias.items())) if any(bias.values()) else (), integral)


def _content(ours: Xml.Element) -> str:
    if "rows" not in ours.attrib:
        return ours.text or ""
    return "".join(f"\n         {each}" for each in (ours.text or "").split()) + "\n      "


def _place(path: Path, settings: list[_Setting], ours: Mapping[str, str], title: str) -> _Setting:
    """The one setting of a tune with this name and number of rows."""
    name, rows = ours["name"], ours.get("rows")
    found = [each for each in settings if each.attributes.get("name") == name]
    if len(found) != 1 or (rows is not None and found[0].attributes.get("rows") != rows):
        wanted = f"{name} with {rows} rows" if rows else name
        raise MeasurementError(str(path), f"no setting {wanted} in it.", f"A tune of {title} is required.",
                               "Name one of the firmware that runs on your ECU.")  # fmt: skip
    return found[0]


def _read(path: Path, data: bytes, title: str) -> tuple[list[_Setting], int]:
    """Settings of a tune, and the end of its root element, bytes from the begin of the file.

    It uses a parser's events, so that a setting within a comment does not count.
    """
    settings: list[_Setting] = []
    begun: list[tuple[str, Mapping[str, str], int | None]] = []  # name, attributes, content of each open element
    ends: list[int] = []
    parser = expat.ParserCreate(namespace_separator=" ")

    def seen(*_: Any) -> None:
        """The first event after a tag is at the begin of its content."""
        if begun and begun[-1][2] is None:
            begun[-1] = (*begun[-1][:2], parser.CurrentByteIndex)

    def opened(name: str, attributes: dict[str, str]) -> None:
        seen()
        begun.append((name, attributes, None))

    def closed(name: str) -> None:
        seen()
        _, attributes, begin = begun.pop()
        empty = begin is None or data.endswith(b"/>", 0, begin)
        if name == f"{_NAMESPACE} constant" and begin is not None and not empty:
            settings.append(_Setting(attributes, begin, parser.CurrentByteIndex))
        if not begun and name == f"{_NAMESPACE} msq":
            ends.append(parser.CurrentByteIndex)

    def refused(*_: Any) -> None:
        raise expat.ExpatError("a tune has no document type")

    parser.StartElementHandler, parser.EndElementHandler, parser.DefaultHandler = opened, closed, seen
    parser.StartDoctypeDeclHandler = refused
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError):
        ends.clear()
    if not ends or not data.startswith(b"</", ends[0]):
        raise MeasurementError(str(path), "it is no tune of TunerStudio.", f"A .msq of {title} is required.",
                               "Save one in TunerStudio: File, Save Tune As.")  # fmt: skip
    return settings, ends[0]


MSQ = Format("msq", "gains and bias table for TunerStudio (rusEFI, FOME)", _export, changes=True)
