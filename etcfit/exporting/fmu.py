"""An FMU (FMI 3.0) around the C of the plant, for co-simulation."""

from __future__ import annotations

import io
import os
import platform
import shlex
import shutil
import subprocess
import sys
import uuid
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree as Xml

from ..errors import UsageError
from ..rig.user_text import one_line
from .base import Export, Format, Source, rendered
from .plant import Plant, c_cannot_hold, c_files, plant_of

NAME = "etcfit_plant"
_LOG = "logStatusError"
_NO_MODEL_EXCHANGE = (
    "Co-simulation only. Model exchange hands dx/dt to the importer's solver; with dry friction as a set-valued law "
    "there is no dx/dt of a sticking plate, and a smoothed one would creep where the plate rests."
)
_NOT_HERE = (
    *(f"{verb}{kind}" for kind in ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64",
                                   "Boolean", "String", "Binary", "Clock") for verb in ("Get", "Set")),
    "EnterEventMode", "EnterStepMode", "EnterConfigurationMode", "ExitConfigurationMode", "EnterContinuousTimeMode",
    "GetNumberOfVariableDependencies", "GetVariableDependencies", "SerializedFMUStateSize", "SerializeFMUState",
    "DeserializeFMUState", "GetDirectionalDerivative", "GetAdjointDerivative", "GetIntervalDecimal",
    "GetIntervalFraction", "GetShiftDecimal", "GetShiftFraction", "SetIntervalDecimal", "SetIntervalFraction",
    "SetShiftDecimal", "SetShiftFraction", "EvaluateDiscreteStates", "UpdateDiscreteStates", "CompletedIntegratorStep",
    "SetTime", "SetContinuousStates", "GetContinuousStateDerivatives", "GetEventIndicators", "GetContinuousStates",
    "GetNominalsOfContinuousStates", "GetNumberOfEventIndicators", "GetNumberOfContinuousStates",
    "GetOutputDerivatives", "ActivateModelPartition",
)  # fmt: skip


_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}


_OUTPUTS = (
    ("angle", "rad", "of the plate"),
    ("speed", "rad/s", "of the plate"),
    ("current", "A", "in the armature"),
    ("sensor_angle", "rad", "what the position sensor shows"),
    ("sensor_current", "A", "what the current sensor shows"),
)
_SENSOR = ("sensor_voltage", "V", "of the position sensor")


def _variable(
    name: str, unit: str, description: str, causality: str, variability: str, initial: str | None = None,
    start: float | None = None,
) -> dict[str, str]:  # fmt: skip
    """A line of modelDescription.xml: attributes of a Float64 without its value reference."""
    given = {"name": name, "description": one_line(description), "causality": causality, "variability": variability,
             "initial": initial, "unit": None if unit == "1" else unit, "start": start}  # fmt: skip
    return {key: str(value) for key, value in given.items() if value is not None}


def _variables(source: Source, plant: Plant) -> list[dict[str, str]]:
    """Variables in the order of their value references."""
    torque = "at the plate besides the motor's, through the gear like it; positive opens"
    outputs = (*_OUTPUTS, _SENSOR) if plant.sensor else _OUTPUTS
    return [
        _variable("time", "s", "since the begin", "independent", "continuous"),
        _variable("voltage", "V", "at the terminals, held over a communication step", "input", "continuous", start=0.0),
        _variable("torque", "N*m", torque, "input", "continuous", start=0.0),
        *(_variable(*each, "output", "continuous", "calculated") for each in outputs),
        *(_variable(q.symbol, q.unit, q.meaning, "parameter", "tunable", "exact", q.value) for q in plant.quantities),
        _variable("start_angle", "rad", "of the plate at the begin", "parameter", "fixed", "exact", source.travel[0]),
    ]


def _described(source: Source, variables: list[dict[str, str]], token: str, lost: tuple[str, ...]) -> str:
    """modelDescription.xml."""
    root = Xml.Element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": NAME, "instantiationToken": token, "generationTool": "etcfit",
        "variableNamingConvention": "flat", "description": one_line(" ".join((source.title, source.origin, *lost))),
    })  # fmt: skip
    Xml.SubElement(root, "CoSimulation", {
        "modelIdentifier": NAME, "canHandleVariableCommunicationStepSize": "true", "canGetAndSetFMUState": "true",
        "fixedInternalStepSize": repr(source.settings.step),
    })  # fmt: skip
    units = Xml.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(v["unit"] for v in variables if "unit" in v):
        Xml.SubElement(units, "Unit", {"name": unit})
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", {"name": _LOG, "description": "what was refused, and why"})
    # with this step every clock of an importer is a whole number of steps
    experiment = {"startTime": "0", "stopTime": "1", "stepSize": repr(source.settings.step)}
    Xml.SubElement(root, "DefaultExperiment", experiment)
    lines = Xml.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        Xml.SubElement(lines, "Float64", {"name": variable["name"], "valueReference": str(reference), **variable})
    structure = Xml.SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for reference, variable in enumerate(variables):
            if variable["causality"] == "output":
                Xml.SubElement(structure, kind, {"valueReference": str(reference)})
    return _text(root)


def _text(root: Xml.Element) -> str:
    Xml.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'


def _build_description() -> str:
    """sources/buildDescription.xml: the build of the binary for another platform."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": NAME})
    files = Xml.SubElement(build, "SourceFileSet", {"language": "C99"})
    for name in ("etcfit_plant.c", "fmi3.c"):
        Xml.SubElement(files, "SourceFile", {"name": name})
    return _text(root)


def compiler() -> list[str]:
    """The system's C compiler: that of the environment variable CC, else cc, gcc or clang.

    Raises:
        UsageError: there is no compiler.
    """
    named = shlex.split(os.environ.get("CC", ""))
    for command in (named, ["cc"], ["gcc"], ["clang"]):
        if command and shutil.which(command[0]):
            return command
    raise UsageError("An FMU holds a binary for this machine, and no C compiler is found here (cc, gcc, clang). "
                     "Install one, name one in the environment variable CC, or take `--to c`.")  # fmt: skip


def _platform() -> tuple[str, str]:
    """FMI's name of this platform, and the suffix of a shared library here."""
    if sys.platform not in _SYSTEMS:
        raise UsageError(f"FMI has no name for the platform {sys.platform}. Take `--to c`.")
    machine = platform.machine().lower()
    system, suffix = _SYSTEMS[sys.platform]
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{machine}-{system}", suffix


def _binary(sources: Mapping[str, str], suffix: str) -> bytes:
    """The shared library."""
    command = compiler()
    with TemporaryDirectory() as scratch:
        for name, text in sources.items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        library = f"{NAME}{suffix}"
        files = [name for name in sources if name.endswith(".c")]
        how = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", *files, "-lm", "-o", library]
        done = subprocess.run([*command, *how], cwd=scratch, capture_output=True, text=True, check=False)
        if done.returncode:
            raise UsageError(f"{' '.join(command)} does not compile the plant: {done.stderr.strip()[:500]}")
        return (Path(scratch) / library).read_bytes()


def _export(source: Source) -> Export:
    plant = plant_of(source)
    lost = (*c_cannot_hold(source), _NO_MODEL_EXCHANGE,
            f"A communication step must be a whole number of {source.settings.step:g} s.")  # fmt: skip
    variables, notes = _variables(source, plant), (*source.cautions, *lost)
    files = c_files(source, plant, lost)
    # the same model gives the same FMU
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, ''.join(files.values()))}}}"
    count = Counter(variable["causality"] for variable in variables)
    files["fmi3.c"] = rendered(
        "fmi3.c", title=source.title, token=token, start=source.travel[0], inputs=count["input"],
        outputs=count["output"], parameters=len(plant.quantities), not_here=_NOT_HERE,
    )  # fmt: skip
    here, suffix = _platform()
    content: dict[str, str | bytes] = {
        "modelDescription.xml": _described(source, variables, token, notes),
        f"binaries/{here}/{NAME}{suffix}": _binary(files, suffix),
        "sources/buildDescription.xml": _build_description(),
        **{f"sources/{name}": text for name, text in files.items()},
        "documentation/index.html": rendered("fmu.html", title=source.title, origin=source.origin, notes=notes),
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)
    lost = (*notes, f"Its binary is for {here}; its sources build elsewhere.")
    return Export({f"{NAME}.fmu": packed.getvalue()}, lost)


FMU = Format(
    "fmu",
    "FMI 3.0 co-simulation, with sources and a binary for this machine",
    _export,
    tools=lambda: (_platform(), compiler()),
)
