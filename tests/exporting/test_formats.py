"""Every format is read back by a program that it is for, and says what it cannot hold."""

from __future__ import annotations

import ast
import inspect
import io
import re
import sys
import time
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints
from xml.etree import ElementTree as Xml

import jax
import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

import bodies
import etcfit
import exports
import results
import runs
from etcfit.api.controller import Designed
from etcfit.api.fit import Fit
from etcfit.cli import app, export
from etcfit.control.design import ecu_of, task_of
from etcfit.control.loop_figures import REQUIRED
from etcfit.control.pid import Gains, Requirements
from etcfit.control.pid.loop import Body, Loop
from etcfit.control.setpoint import Setpoint
from etcfit.errors import MeasurementError, UsageError
from etcfit.estimation.fitted_model import FitState
from etcfit.exporting import FORMATS, Export, Source, named, write
from etcfit.exporting.plant import c_files, plant_of
from etcfit.exporting.tune import read_tune
from etcfit.files import write_json
from etcfit.model.ecu import Ecu
from etcfit.model.ecus import ECUS
from etcfit.model.effects import Inputs, State
from etcfit.model.pid import Memory, tick
from etcfit.run_folder.manifest import replacing
from etcfit.run_folder.reading import read_design
from etcfit.stages import Done

# constants of a tune that TunerStudio wrote for rusEFI 2022.04.22 (proteus_f4), with their rows: its .ini's names
INI = {"etb_pFactor": 1, "etb_iFactor": 1, "etb_dFactor": 1, "etb_offset": 1, "etb_periodMs": 1, "etb_minValue": 1,
       "etb_maxValue": 1, "etb_iTermMin": 1, "etb_iTermMax": 1, "etbBiasBins": 8, "etbBiasValues": 8}  # fmt: skip
MSQ = "{http://www.msefi.com/:msq}"


def pid(name: str | None = "rusefi") -> dict[str, Any]:
    """What an export needs of pid.json, invented."""
    made = None
    if name is not None:
        profile = ECUS[name]
        numbers = iter(np.linspace(0.5, 9.5, 20).tolist())
        bias = profile.bias and {
            profile.bias.bins: list(range(0, 80, 10)),
            profile.bias.values: [1.5 * k for k in range(8)],
        }
        made = {
            "name": name, "title": profile.title, "assumed": ["nothing & nobody"], "bias": bias,
            "gains": {gain: {"value": next(numbers), "unit": ""} for gain in profile.gains},
            "limits": {limit.name: {"value": next(numbers), "unit": ""} for limit in profile.limits},
        }  # fmt: skip
    return {"profile": made, "feed_forward": True, "gains": {"Kp": 11.0, "Ki": 50.0, "Kd": 0.2, "unit": "V/rad"}}


def text(export: Export, name: str) -> str:
    content = export.files[name]
    return content if isinstance(content, str) else content.decode("iso-8859-1")


def executed(code: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(ast.parse(code), "snippet", "exec"), names)
    return names


def words(said: str) -> str:
    """Without marks of comments and line ends."""
    return " ".join(line.strip().removeprefix("* ").removeprefix("# ").removeprefix("% ") for line in said.splitlines())


COMPILED = ("c", "m", "python")  # these compile the model: slow
TEXTS = [pytest.param(f.name, marks=[pytest.mark.slow] * (f.name in COMPILED))
         for f in FORMATS if f.name not in ("fmu", "mat")]  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_what_a_format_cannot_hold_is_said_in_its_first_file(name: str) -> None:
    export = named(name).export(exports.source({"limp_home_spring": {}}, pid=pid()))
    first = words(text(export, next(iter(export.files))))
    assert export.cannot_hold
    assert [sentence for sentence in export.cannot_hold if sentence not in first] == []
    assert "SYNTHETIC" in first


def test_an_unknown_format_is_refused_with_all_that_there_are() -> None:
    with pytest.raises(UsageError) as error:
        named("simulink")
    assert [f.name for f in FORMATS if f"{f.name} (" not in str(error.value)] == []


def test_help_and_documentation_name_every_format() -> None:
    told = inspect.getdoc(etcfit.export) or ""
    shown = get_type_hints(export, include_extras=True)["to"].__metadata__[0].help
    page = (Path(__file__).parents[2] / "docs" / "reference" / "commands" / "export.md").read_text(encoding="utf-8")
    *names, last = (f.name for f in FORMATS)
    for said in (told, shown):
        assert f"{', '.join(names)} or {last}" in " ".join(said.split())
    assert [f.name for f in FORMATS if f"| `{f.name}` |" not in page] == []


def transfer(source: Source, s: complex) -> complex:
    """G(s) of the linear equations, rad/V."""
    a = bodies.linear(dict(source.values))
    return complex(np.linalg.solve(s * np.eye(3) - a[:3, :3], a[:3, 3])[1])


@pytest.mark.slow
def test_python_executes_and_agrees_with_the_equations() -> None:
    source = exports.source(pid=pid())
    names = executed(text(named("python").export(source), "etcfit_model.py"))
    s = 30j
    _, response = names["plant"].freqresp([30.0])
    assert response[0] == pytest.approx(transfer(source, s), rel=1e-9)
    assert complex(names["to_control"]()(s)) == pytest.approx(transfer(source, s), rel=1e-9)
    assert names["parameters"] == {**source.values, **source.body}
    assert names["gains"] == {"Kp": 11.0, "Ki": 50.0, "Kd": 0.2}


@pytest.mark.slow
def test_python_keeps_delay_and_lag_beside_the_transfer_function() -> None:
    effects = {"actuation_delay": {"t_a": 2e-3}, "position_sensor_lag": {"tau_p": 5e-3}}
    names = executed(text(named("python").export(exports.source(effects)), "etcfit_model.py"))
    assert (names["delay"], names["lag"]) == pytest.approx((2e-3, 5e-3), rel=1e-6)
    late = complex(names["to_control"](3)(30j)) / complex(names["to_control"]()(30j))
    assert late == pytest.approx(np.exp(-30j * names["delay"]) / (1.0 + 30j * names["lag"]), rel=1e-6)


@pytest.mark.slow
def test_the_mat_file_is_read_back() -> None:
    source = exports.source(pid=pid())
    export = named("mat").export(source)
    data = export.files["etcfit.mat"]
    assert isinstance(data, bytes)
    back = scipy.io.loadmat(io.BytesIO(data), simplify_cells=True)["etcfit"]
    assert back["parameters"] == pytest.approx({**source.values, **source.body})
    tf = back["transfer_function"]
    assert np.polyval([tf["num"]], 30j) / np.polyval(tf["den"], 30j) == pytest.approx(transfer(source, 30j), rel=1e-9)
    assert tf["den_stderr"][0] == 0.0
    assert np.all(tf["den_stderr"][1:] > 0.0)
    assert back["gains"] == {"Kp": 11.0, "Ki": 50.0, "Kd": 0.2}
    assert [str(back["notes"])] == list(export.cannot_hold) or back["notes"].tolist() == list(export.cannot_hold)


@pytest.mark.slow
def test_the_script_for_matlab_says_the_same() -> None:
    source = exports.source()
    lines = text(named("m").export(source), "etcfit_model.m").splitlines()
    values = dict(line.split("%")[0].strip().rstrip(";").split(" = ") for line in lines if " = " in line.split("%")[0]
                  and not line.startswith(" "))  # fmt: skip
    assert {k: float(values[f"p.{k}"]) for k in source.values} == source.values
    num, den = (np.array(values[name].strip("[]").split(","), dtype=float) for name in ("num", "den"))
    assert np.polyval(num, 30j) / np.polyval(den, 30j) == pytest.approx(transfer(source, 30j), rel=1e-9)


def constants(data: str | bytes) -> dict[str, list[float]]:
    """Of a tune file, as TunerStudio's own: a value, or one a row."""
    root = Xml.fromstring(data)
    version = root.find(f"{MSQ}versionInfo")
    assert root.tag == f"{MSQ}msq"
    assert version is not None
    assert version.attrib["fileFormat"] == "5.0"
    found = {}
    for constant in root.findall(f"{MSQ}page/{MSQ}constant"):
        numbers = [float(each) for each in (constant.text or "").split()]
        assert len(numbers) == int(constant.attrib.get("rows", 1)) * int(constant.attrib.get("cols", 1))
        found[constant.attrib["name"]] = numbers
    return found


@pytest.mark.parametrize("name", ["rusefi", "fome"])
def test_the_tune_holds_what_was_designed_under_the_firmware_s_names(name: str) -> None:
    asked = pid(name)
    found = constants(named("msq").export(exports.source(pid=asked)).files[f"etcfit_{name}.msq"])
    assert {key: len(row) for key, row in found.items()}.items() <= INI.items()
    profile = asked["profile"]
    assert {key: found[key] for key in profile["bias"]} == profile["bias"]
    for key, gain in profile["gains"].items():
        assert found[key] == pytest.approx([gain["value"]], rel=1e-7)
    assert set(found) == {*profile["gains"], *profile["limits"], *profile["bias"]}


@pytest.mark.parametrize(
    ("of", "said"), [(None, "none were designed"), (pid(None), "no make of ECU"), (pid("link"), "typed in")]
)
def test_without_gains_for_such_an_ecu_the_tune_is_refused_with_the_command(of: Any, said: str) -> None:
    with pytest.raises(UsageError, match=rf"{said}.*etcfit design RUN --ecu NAME.*rusefi, fome"):
        named("msq").export(exports.source(pid=of))


def test_present_gains_are_read_off_a_tune(tmp_path: Path) -> None:
    export = named("msq").export(exports.source(pid=pid("rusefi")))
    tune = tmp_path / "mine.msq"
    written = export.files["etcfit_rusefi.msq"]
    tune.write_bytes(written.encode() if isinstance(written, str) else written)
    designed = [gain["value"] for gain in pid("rusefi")["profile"]["gains"].values()]
    with pytest.raises(MeasurementError, match=r"etb_iTermMin.*found 3.3, and 3.8 as etb_iTermMax"):
        read_tune(tune, ECUS["rusefi"])
    tune.write_bytes(tune.read_bytes().replace(b"etb_iTermMin", b"other"))
    assert read_tune(tune, ECUS["rusefi"]).gains == pytest.approx(designed, rel=1e-7)
    with pytest.raises(UsageError, match=r"Link.*no tune file.*--present"):
        read_tune(tune, ECUS["link"])
    tune.write_bytes(tune.read_bytes().replace(b"etb_iFactor", b"other"))
    with pytest.raises(MeasurementError, match="no setting etb_iFactor"):
        read_tune(tune, ECUS["rusefi"])


def test_a_bias_table_is_read_off_a_tune_and_one_of_zeros_is_none(tmp_path: Path) -> None:
    mine = tmp_path / "mine.msq"
    mine.write_bytes(tune())
    found = read_tune(mine, ECUS["rusefi"])
    assert (found.gains, found.integral) == ((30.0, 30.0, 30.0), 0.3)
    assert found.bias == tuple((float(k), float(k)) for k in range(8))
    mine.write_bytes(tune({name: rows for name, rows in INI.items() if rows == 1}))
    assert read_tune(mine, ECUS["rusefi"]).bias == ()
    before, values = tune().split(b'name="etbBiasValues"')
    mine.write_bytes(before + b'name="etbBiasValues"' + re.sub(rb"\d\.0", b"0.0", values))
    assert read_tune(mine, ECUS["rusefi"]).bias == ()


COMPROMISE = FitState(17.0, True, "", "the model is far from the data (chi2/dof 17)")


@pytest.mark.parametrize("state", [COMPROMISE, FitState(1.0, False, "out of steps", None)])
def test_gains_of_a_model_that_is_no_estimate_are_no_tune_unless_asked_for_all_the_same(state: FitState) -> None:
    sound = exports.source(pid=pid())
    source = replace(sound, fitted=replace(sound.fitted, state=state))
    with pytest.raises(UsageError, match=r"No tune is written.*etcfit diagnose.*etcfit design RUN.*--anyway"):
        named("msq").export(source)
    export = named("msq").export(replace(source, anyway=True))
    assert export.cannot_hold[0] == state.cautions[0]
    assert constants(export.files["etcfit_rusefi.msq"]) == constants(
        named("msq").export(sound).files["etcfit_rusefi.msq"]
    )


def test_the_command_asks_for_it_by_an_option(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[Any] = []
    monkeypatch.setattr("etcfit.stages.opened", lambda run, out=None: run)
    monkeypatch.setattr("etcfit.stages.export_run", lambda *args: asked.append(args[-1]) or Done("a.msq"))
    for options in ((), ("--anyway",)):
        assert CliRunner().invoke(app, ["export", str(tmp_path), "--to", "msq", "-q", *options]).exit_code == 0
    assert asked == [False, True]


@pytest.mark.slow
def test_a_real_design_becomes_a_tune(tmp_path: Path) -> None:
    fit = results.result(results.rig(tmp_path / "rig"))
    fitted, rusefi = fit.fitted(), ECUS["rusefi"]
    modest = Requirements(**dict.fromkeys(REQUIRED, 1e9))
    task = task_of(
        fitted, ecu_of(fitted, **rusefi.fixes), modest, settings=replace(results.BRIEF, draws=2), profile=rusefi
    )
    design = results.proposed(fitted, task, "amigo")
    designed = Designed(Fit(fit), design)
    with pytest.raises(UsageError, match="Name one"):
        etcfit.export(designed, "msq", quiet=True)
    done = etcfit.export(designed, "msq", tmp_path / "out", quiet=True)
    found = constants(done.files[0].read_bytes())
    assert set(found) == set(INI) - {"etb_periodMs"}
    body, supply = task.loop.body, task.ecu.supply
    # volts per radian in per cent of duty per per cent of travel
    assert found["etb_pFactor"] == pytest.approx([designed.gains.Kp * (body.upper - body.lower) / supply], rel=1e-6)
    assert found["etbBiasValues"] == [0.0] * 8  # found without feed-forward


TUNE = """<?xml version="1.0" encoding="ISO-8859-1"?>
<msq xmlns="http://www.msefi.com/:msq">
<versionInfo fileFormat="5.0" firmwareInfo="rusEFI" nPages="1" signature="rusEFI by hand"/>
<page number="0" size="99">
<constant digits="1" name="clt_tempC_1" units="*C">-10.0</constant>
%s
<constant name="myPin">"PA\xb52"</constant>
</page>
</msq>
"""


def tune(names: Any = INI) -> bytes:
    """A tune with settings of rusEFI, laid out as TunerStudio does; SYNTHETIC."""

    def constant(name: str, rows: int) -> str:
        if rows == 1:
            value = "-30.0" if name == "etb_iTermMin" else "30.0"
            return f'<constant digits="0" name="{name}" units="x">{value}</constant>'
        values = "".join(f"\n         {k}.0" for k in range(rows))
        return f'<constant cols="1" digits="2" name="{name}" rows="{rows}" units="%">{values}\n      </constant>'

    return (TUNE % "\n".join(constant(name, names[name]) for name in names)).encode("iso-8859-1")


def test_a_copy_of_the_users_own_tune_has_the_designed_settings_and_no_other_change(tmp_path: Path) -> None:
    mine = tmp_path / "mine.msq"
    mine.write_bytes(tune())
    source = exports.source(pid=pid())
    found = named("msq").export(replace(source, into=mine)).files["mine_etcfit.msq"]
    assert isinstance(found, bytes)
    designed = constants(named("msq").export(source).files["etcfit_rusefi.msq"])
    before, after = (Xml.fromstring(data).findall(f"{MSQ}page/{MSQ}constant") for data in (tune(), found))
    for old, new in zip(before, after, strict=True):
        name = old.attrib["name"]
        assert new.attrib == old.attrib
        if name in designed:
            assert [float(each) for each in (new.text or "").split()] == designed[name]
        else:
            assert new.text == old.text
    assert b'signature="rusEFI by hand"' in found
    assert mine.read_bytes() == tune()


def test_what_stands_in_a_comment_of_the_users_tune_is_no_setting(tmp_path: Path) -> None:
    mine = tmp_path / "mine.msq"
    old = b'<!-- <constant name="etb_pFactor">7.0</constant> </msq> -->'
    mine.write_bytes(tune().replace(b"<versionInfo", old + b"<versionInfo").replace(b"-10.0</", b"-10.0<!-- 9 --></"))
    found = named("msq").export(replace(exports.source(pid=pid()), into=mine)).files["mine_etcfit.msq"]
    assert isinstance(found, bytes)
    assert found.count(old) == 1
    (gain,) = Xml.fromstring(found).findall(f"{MSQ}page/{MSQ}constant[@name='etb_pFactor']")
    assert float(gain.text or "") != 30.0
    assert found.endswith(b"-->\n</msq>\n")


def test_a_long_tune_is_changed_at_once(tmp_path: Path) -> None:
    mine = tmp_path / "mine.msq"
    tags = b'<constant name="y" x="' + b"a" * 200_000 + b'">2</constant>' + b"<constant/>" * 200_000
    mine.write_bytes(tune().replace(b"</page>", tags + b"</page>"))
    begun = time.process_time()
    named("msq").export(replace(exports.source(pid=pid()), into=mine))
    assert time.process_time() - begun < 10.0  # hours, where each tag is held against each


# the rig's name is data: see tests/rig/test_comments.py for the grammar of each language
HOSTILE = (
    "coding: unicode_escape \\u000araise SystemExit",
    "-*- coding: utf-7 -*- +AAo-raise SystemExit",
    f"{'a ' * 45}*\\ / #error hostile /*",
    "*??/\n/ #error hostile /*",
    "*/ #error hostile /*",
    '---> <constant name="hostile">1</constant> <!---',
    '"/> <hostile/> ]]> &amp; <!DOCTYPE x>',
    "line\r\nraise SystemExit\x85#error hostile\u2028raise SystemExit\x00\x1b\u202e\ud800",
)
hostile = pytest.mark.parametrize("name", HOSTILE)


def called(name: str, **more: Any) -> Source:
    """A model of a rig with this name."""
    sound = exports.source(pid=pid(), **more)
    return replace(sound, fitted=replace(sound.fitted, config=replace(sound.fitted.config, name=name)))


@hostile
def test_no_name_of_a_rig_is_markup(name: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine.msq"
    mine.write_bytes(tune())
    for of, into in (("mujoco", None), ("msq", None), ("msq", mine)):
        innocent, found = (named(of).export(replace(called(each), into=into)).files for each in ("rig", name))
        trees = [[(each.tag, each.text) for each in Xml.fromstring(next(iter(files.values()))).iter()]
                 for files in (innocent, found)]  # fmt: skip
        assert trees[0] == trees[1]


def named_in_turn(innocent: Source) -> Iterator[Source]:
    """The model of a rig with each of these names, traced and reduced once."""
    innocent.reduction  # noqa: B018
    for name in HOSTILE:
        found = replace(innocent, fitted=called(name).fitted)
        found.__dict__["reduction"] = innocent.reduction
        yield found


@pytest.mark.slow
@exports.needs_a_compiler
def test_no_name_of_a_rig_is_code_in_c(tmp_path: Path) -> None:
    plant = plant_of(called("rig"))
    for source in named_in_turn(called("rig")):
        made = {**c_files(source, plant, ("note",)), "main.c": "int main(void) { return 0; }\n"}
        exports.compiled(Export(made), tmp_path / "c", "main.c")


@pytest.mark.slow
@exports.needs_a_compiler
def test_no_name_of_a_rig_is_code_or_markup_in_an_fmu() -> None:
    (packed,) = named("fmu").export(called(" ".join(HOSTILE))).files.values()
    assert isinstance(packed, bytes)
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        described, page, front = (
            archive.read(name).decode()
            for name in ("modelDescription.xml", "documentation/index.html", "sources/fmi3.c")
        )
    assert "hostile" not in {each.tag for each in Xml.fromstring(described).iter()}
    assert "<hostile" not in page
    assert "hostile" not in re.sub(r"/\*.*?\*/", "", front, flags=re.DOTALL)


@pytest.mark.parametrize("of", ["isaac", *(pytest.param(each, marks=pytest.mark.slow) for each in ("python", "m"))])
def test_no_name_of_a_rig_is_code_in_a_script(of: str) -> None:
    innocent = called("rig")
    wanted = code(of, innocent)
    for source in map(called, HOSTILE) if of == "isaac" else named_in_turn(innocent):
        assert code(of, source) == wanted


def code(of: str, source: Source) -> str:
    """What is no comment; as Python itself reads it, where it is that."""
    (found,) = (content for path, content in named(of).export(source).files.items() if path.endswith((".py", ".m")))
    assert isinstance(found, str)
    if of != "m":
        return ast.dump(ast.parse(found.encode()))
    return "\n".join(line for line in found.splitlines() if not line.startswith("% "))


@pytest.mark.parametrize("piece", [b"<constant ", b"<!-- ", b'<constant name="x">1', b"<constant name="])
def test_a_tune_of_200000_broken_tags_is_refused_at_once(tmp_path: Path, piece: bytes) -> None:
    mine = tmp_path / "mine.msq"
    mine.write_bytes(b'<msq xmlns="http://www.msefi.com/:msq">' + 200_000 * piece)
    begun = time.process_time()
    with pytest.raises(MeasurementError, match=r"mine\.msq: it is no tune"):
        named("msq").export(replace(exports.source(pid=pid()), into=mine))
    assert time.process_time() - begun < 5.0  # a minute and more, where each tag is sought from each


@pytest.mark.parametrize(("data", "said"), [
    (b"<xml/>", "it is no tune"),
    (tune().replace(b"</page>", b""), "it is no tune"),
    (tune().replace(b"<msq ", b"<!DOCTYPE msq [<!ENTITY a 'b'>]><msq "), "it is no tune"),
    (tune().decode("iso-8859-1").replace("ISO-8859-1", "UTF-16").encode("utf-16"), "it is no tune"),
    (tune({"etb_dFactor": 1}).replace(b'name="etb_dFactor" units="x">30.0</constant>', b'name="etb_pFactor"/>'),
     "no setting etb_pFactor"),
    (tune({name: rows for name, rows in INI.items() if name != "etb_dFactor"}), "no setting etb_dFactor"),
    (tune(INI | {"etbBiasBins": 6}), "no setting etbBiasBins with 8 rows"),
])  # fmt: skip
def test_a_tune_of_something_else_is_refused_by_name(tmp_path: Path, data: bytes, said: str) -> None:
    mine = tmp_path / "mine.msq"
    mine.write_bytes(data)
    with pytest.raises(MeasurementError, match=rf"mine\.msq: {said}.*required"):
        named("msq").export(replace(exports.source(pid=pid()), into=mine))


@pytest.mark.parametrize(("of", "into", "said"), [
    ("c", Path("mine.c"), "--to c writes new files"),
    ("mujoco-position", None, r"rig.toml describes no ECU.*etcfit design RUN.*\[ecu\] of rig.toml"),
])  # fmt: skip
def test_what_a_format_cannot_take_or_do_without_is_refused(of: str, into: Path | None, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        named(of).export(replace(exports.source(), into=into))


def test_what_the_data_do_not_tell_is_said() -> None:
    sure = exports.source()
    assert not any("do not tell" in each for each in sure.cautions)
    free = sure.fitted.free_parameters.layout.free
    covariance = sure.fitted.covariance.copy()
    covariance[free.index("L_a"), free.index("L_a")] = np.inf
    unsure = replace(sure, fitted=replace(sure.fitted, covariance=covariance))
    assert any("do not tell L_a alone" in each for each in unsure.cautions)


def test_gains_of_a_run_are_those_that_lie_there(tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    assert read_design(run) is None
    with replacing(run, "design", 0, {}) as draft:
        write_json(draft / "pid.json", "pid", pid())
    found = read_design(run)
    assert found is not None
    assert found["profile"]["name"] == "rusefi"


@pytest.mark.slow
def test_the_command_exports_a_run_and_says_what_is_left_out(tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    done = CliRunner().invoke(app, ["export", str(run), "--to", "mujoco", "--quiet"])
    file, answer, look, further = done.stdout.splitlines()
    assert (done.exit_code, file) == (0, str(run / "export" / "etcfit_throttle.xml"))
    assert answer.startswith("Answer: 1 file written, MuJoCo joint and actuator (MJCF)")
    assert look == f"Look:   {file}"
    assert further.startswith("Next:   ")
    assert "The inductance L_a" in done.stderr
    made = etcfit.export(run, "mujoco", tmp_path / "here", quiet=True)
    assert made.files[0].read_bytes() == (run / "export" / "etcfit_throttle.xml").read_bytes()
    assert done.stderr == "".join(f"{sentence}\n" for sentence in made.cannot_hold)
    refused = CliRunner().invoke(app, ["export", str(run), "--to", "msq", "--quiet"])
    assert refused.exit_code == 2
    assert f"etcfit design {run} --ecu NAME" in refused.stderr


FREE = 3e-3  # of the travel, between MuJoCo's free return and ours
DRIVEN = 0.01  # of the travel, under a step of the voltage: MuJoCo's motor has no inductance


def ours(source: Source, circuit: float, volts: float, start: float, duration: float) -> np.ndarray:
    """Angle along a run of our own stepper, a sample a step, rad."""
    h = source.settings.step
    steps, resets = bodies.batch(bodies.even(duration, round(duration / h)), volts, circuit=circuit,
                                 start=(0.0, start, 0.0))  # fmt: skip
    return bodies.path(source.throttle, steps, resets)[:, 1]


@pytest.mark.slow
@pytest.mark.parametrize(("circuit", "volts", "start", "within"), [(0.0, 0.0, 1.4, FREE), (1.0, 8.0, 0.05, DRIVEN)])
def test_mujoco_returns_and_opens_as_our_stepper(circuit: float, volts: float, start: float, within: float) -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed: pip install '.[test]'")

    source = exports.source()
    model = mujoco.MjModel.from_xml_string(text(named("mujoco").export(source), "etcfit_throttle.xml"))
    if not circuit:
        model.actuator_biasprm[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[0], data.ctrl[0] = start, volts
    path = [start]
    while path[-1] > 0.02 and path[-1] < 1.5 and len(path) < 1000:  # before a stop, which is soft there
        mujoco.mj_step(model, data)
        path.append(float(data.qpos[0]))
    mine = ours(source, circuit, volts, start, (len(path) - 1) * source.settings.step)
    assert abs(path[-1] - start) > 1.2
    assert np.max(np.abs(np.array(path) - mine)) / np.ptp(source.travel) < within


SERVO = 0.005  # of the travel, a step of a servo
KP, KD, ASKED = 25.0, 0.6, 0.9  # V/rad, V s/rad, rad
PERIOD = 1e-4  # s, of a controller so fast that it is one of continuous time


def servo() -> tuple[Source, dict[str, float]]:
    """A model under its own controller, and the numbers of the position actuator that it is written as."""
    gains = {"Kp": KP, "Ki": 0.0, "Kd": KD, "unit": "V/rad"}
    source = exports.source(settings=etcfit.ExportSettings(step=2e-4), pid={**pid(None), "gains": gains})
    root = Xml.fromstring(text(named("mujoco-position").export(source), "etcfit_servo.xml"))
    actuator, joint = root.find("actuator/position"), root.find("worldbody/body/joint")
    assert actuator is not None
    assert joint is not None
    inertia = root.find("worldbody/body/inertial")
    assert inertia is not None
    numbers = {name: float(actuator.attrib[name]) for name in ("kp", "kv")}
    numbers |= {name: float(joint.attrib[name]) for name in ("armature", "damping", "frictionloss", "stiffness",
                                                             "springref")}  # fmt: skip
    return source, numbers | {"inertia": float(inertia.attrib["diaginertia"].split()[2]),
                              "force": float(actuator.attrib["forcerange"].split()[1])}  # fmt: skip


def of_our_loop(source: Source, times: np.ndarray, start: float) -> np.ndarray:
    """Angle under our own discrete controller, its derivative of the position alone, rad."""
    throttle = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float)[None], source.throttle)
    low, high = source.travel
    ecu = Ecu(PERIOD, 12.0, filter=0.0, derivative_weight=0.0)
    loop = Loop(throttle, Body(source.body["N"], low, high), ecu)
    share, held = ASKED / (high - low), start / (high - low)
    setpoint = Setpoint((0.0, times[-1] + PERIOD), (share, share), ())
    first = Memory.at_rest(Gains(KP, 0.0, KD), ecu, start)
    path = loop.run(tick, Gains(*(np.array([g]) for g in (KP, 0.0, KD))), first, setpoint, State(0.0, start, 0.0))
    assert 0.0 < held < share
    return np.interp(times, setpoint.instants(PERIOD), np.asarray(path.position)[0, 0])


@pytest.mark.slow
def test_a_position_actuator_by_its_published_equations_steps_as_our_loop() -> None:
    """(J + armature) dw/dt = clip(kp (ctrl - q) - kv w) - damping w - stiffness (q - springref) -+ frictionloss."""
    source, a = servo()
    h, start = 2e-5, 0.4
    q, w, path = start, 0.0, [start]
    for _ in range(round(0.5 / h)):
        force = np.clip(a["kp"] * (ASKED - q) - a["kv"] * w, -a["force"], a["force"])
        torque = force - a["damping"] * w - a["stiffness"] * (q - a["springref"])
        loss = np.clip(torque + (a["inertia"] + a["armature"]) * w / h, -a["frictionloss"], a["frictionloss"])
        w += h * (torque - loss) / (a["inertia"] + a["armature"])
        q += h * w
        path.append(q)
    mine = of_our_loop(source, h * np.arange(len(path)), start)
    assert abs(path[-1] - start) > 0.3
    assert np.max(np.abs(np.array(path) - mine)) / np.ptp(source.travel) < SERVO


@pytest.mark.slow
def test_mujoco_s_position_actuator_steps_as_our_loop() -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed: pip install '.[test]'")
    source, _ = servo()
    model = mujoco.MjModel.from_xml_string(text(named("mujoco-position").export(source), "etcfit_servo.xml"))
    data = mujoco.MjData(model)
    start = 0.4
    data.qpos[0], data.ctrl[0] = start, ASKED
    path = [start]
    for _ in range(round(0.5 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        path.append(float(data.qpos[0]))
    mine = of_our_loop(source, model.opt.timestep * np.arange(len(path)), start)
    assert path[-1] - path[-500] < 1e-4  # it sticks, as ours does
    assert np.max(np.abs(np.array(path) - mine)) / np.ptp(source.travel) < SERVO


def test_a_position_actuator_says_what_of_the_controller_it_leaves_out() -> None:
    made = named("mujoco-position").export(exports.source(pid=pid(None)))
    assert any("The integral gain, Ki = 50 V/(rad s)" in each for each in made.cannot_hold)


def test_isaac_s_efforts_are_the_model_s_and_its_configuration_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    package, actuators = ModuleType("isaaclab"), ModuleType("isaaclab.actuators")
    setattr(actuators, "ImplicitActuatorCfg", lambda **fields: given.update(fields))  # noqa: B010
    monkeypatch.setitem(sys.modules, "isaaclab", package)
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)
    source = exports.source()
    names = executed(text(named("isaac").export(source), "etcfit_isaac.py"))
    v, n = source.values, source.body["N"]
    theta, omega, volts = 0.6, 4.0, 5.0
    current = (volts - v["K_b"] * n * omega) / v["R_a"]  # in balance
    c = source.throttle(State(current, theta, omega), (), Inputs(volts, 0.0, 0.0, 1.0, 0.0, n, *source.travel))
    smooth = float(c.torque + c.drive)
    effort = names["motor_effort"](volts, omega) + names["spring_effort"](theta) - given["viscous_friction"] * omega
    assert effort == pytest.approx(smooth, rel=1e-9)
    assert given["armature"] + names["PLATE_INERTIA"] == pytest.approx(float(c.inertia), rel=1e-12)
    assert given["friction"] == given["dynamic_friction"] == pytest.approx(float(c.friction))
    # fields of isaaclab.actuators.ActuatorBaseCfg, Isaac Lab 2.3
    assert set(given) <= {"joint_names_expr", "stiffness", "damping", "armature", "friction", "dynamic_friction",
                          "viscous_friction"}  # fmt: skip


def test_an_export_that_fails_leaves_the_old_files(tmp_path: Path) -> None:
    write(Export({"a.txt": "old", "b.txt": "old"}), tmp_path)
    with pytest.raises(TypeError):
        write(Export({"a.txt": "new", "b.txt": 3}), tmp_path)  # pyright: ignore[reportArgumentType]
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"a.txt": "old", "b.txt": "old"}
