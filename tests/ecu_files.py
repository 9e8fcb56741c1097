"""Logs as programs of engine computers and loggers write them: synthetic drives in the makers' layouts.

Nothing here knows the package, and no file is a real car's: layouts are those that public readers and writers of each
program agree on, the numbers are `drive()`'s. Every file holds traps: signals of the engine under names that resemble
the throttle's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np


class File(NamedTuple):
    """A log."""

    name: str  # of the file
    raw: bytes  # its bytes
    # position, setpoint: what the reader must call them; "" where the log has none
    position: str
    setpoint: str
    digits: float = 0.006  # to which the file holds the drive, per cent


RATE, SECONDS = 50.0, 20.0


def drive() -> dict[str, np.ndarray]:
    """A foot, a plate 60 ms behind it, and an engine; time in s, openings in per cent."""
    time = np.arange(round(SECONDS * RATE)) / RATE

    def foot(t: np.ndarray) -> np.ndarray:
        return 30.0 + 14.0 * np.sin(2 * np.pi * 0.7 * t) + 9.0 * np.sin(2 * np.pi * 0.23 * t + 1.0)

    rpm = 2500.0 + 800.0 * np.sin(0.5 * time)
    return {"time": time, "setpoint": foot(time), "position": foot(time - 0.06), "pedal": 0.9 * foot(time + 0.02),
            "rpm": np.round(rpm), "afr": 13.5 + 1.2 * np.sin(time), "target_afr": 13.2 + np.sin(0.8 * time),
            "injector": 8.0 + 0.1 * foot(time), "gear": np.round(2.0 + np.sin(0.2 * time)),
            "battery": 13.8 + 0.1 * np.sin(3 * time), "minutes": time / 60.0,
            "duty": 18.0 + 6.0 * np.cos(2 * np.pi * 0.7 * time),
            "adc": np.round(100 + 7.0 * foot(time - 0.06))}  # fmt: skip


DRIVE = drive()


def rmse() -> float:
    """Of the drive, per cent."""
    return float(np.sqrt(np.mean((DRIVE["position"] - DRIVE["setpoint"]) ** 2)))


def rows(keys: str, separator: str, forms: Mapping[str, str] | None = None, mark: str = ".") -> list[str]:
    """The drive's rows: a time in ms, anything else to a hundredth, but for those with a form of their own."""
    forms = {"time": "%.3f"} | dict(forms or {})
    cells = zip(*([forms.get(key, "%.2f") % x for x in DRIVE[key]] for key in keys.split()), strict=True)
    return [separator.join(row).replace(".", mark) for row in cells]


def milliseconds(keys: str, separator: str, mark: str = ".") -> list[str]:
    """The drive's rows behind a clock of whole milliseconds."""
    return [f"{1e3 * t:.0f}{separator}{row}"
            for t, row in zip(DRIVE["time"], rows(keys, separator, mark=mark), strict=True)]  # fmt: skip


def labelled(form: str) -> list[str]:
    """The drive's rows in a form of the time, ms or us, the position y and the setpoint r."""
    every = zip(DRIVE["time"], DRIVE["position"], DRIVE["setpoint"], strict=True)
    return [form.format(ms=1e3 * t, us=1e6 * t, y=y, r=r) for t, y, r in every]


def sheet(name: str, head: Sequence[str], keys: str, position: str, setpoint: str, separator: str = ",",
          mark: str = ".", end: str = "\n") -> File:  # fmt: skip
    """A head and below it rows of these keys."""
    return File(name, text([*head, *rows(keys, separator, mark=mark)], end), position, setpoint)


def clocks(first: float = 43200.0, decimal: str = ".") -> list[str]:
    """Times of the day."""
    stamps = [first + t for t in DRIVE["time"]]
    return [f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:06.3f}".replace(".", decimal) for s in stamps]


def text(lines: Iterable[str], end: str = "\n") -> bytes:
    return (end.join(lines) + end).encode()


def haltech() -> File:
    channels = [("Device Battery Voltage", "BatteryVoltage", 1e3, "battery"), ("RPM", "EngineSpeed", 1.0, "rpm"),
                ("Target Lambda", "AFR", 1e3, "target_afr"),
                ("Drive By Wire Accelerator Pedal Position", "Percentage", 10.0, "pedal"),
                ("Throttle Position", "Percentage", 10.0, "position"),
                ("Drive By Wire Throttle 1 Target Position", "Percentage", 10.0, "setpoint"),
                ("Injection Stage 1 Average Duty Cycle", "Percentage", 10.0, "injector")]  # fmt: skip
    head = ["%DataLog%", "DataLogVersion : 1.1", "Software : Haltech NSP", "SoftwareVersion : 999.999.999.999",
            "DownloadDateTime : 20260101 00:00:00"]  # fmt: skip
    for k, (name, kind, _, _) in enumerate(channels):
        head += [
            f"Channel : {name}",
            f"ID : {300 + k}",
            f"Type : {kind}",
            *(["DisplayMaxMin : 1000,0"] if k % 3 else []),
        ]
    head += ["Log Source : 20", "Log Number : 1", "Log : 20260101 12:00:00"]
    cells = np.stack([np.round(scale * DRIVE[key]) for *_, scale, key in channels], axis=1)
    body = [",".join([clock, *(f"{x:.0f}" for x in row)]) for clock, row in zip(clocks(), cells, strict=True)]
    return File("haltech.csv", text([*head, *body], "\r\n"), "Throttle Position [%]",
                "Drive By Wire Throttle 1 Target Position [%]", 0.06)  # fmt: skip


def ecumaster() -> File:
    """EMU Pro: paths for names, each channel in the rows in which it was logged."""
    names = {"engine/rpm": ("rpm", 1), "drivetrain/gearSelector/position": ("gear", 5), "sensors/gear": ("gear", 5),
             "drivetrain/gearbox/rpmMatchingRpmTarget": ("rpm", 5), "sensors/tps1": ("position", 2),
             "dbw/target": ("setpoint", 2)}  # fmt: skip
    lines = [";".join(["TIME", *names])]
    for k, t in enumerate(DRIVE["time"]):
        lines.append(
            ";".join([f"{t:.3f}", *(f"{DRIVE[key][k]:.3f}" if k % every == 0 else "" for key, every in names.values())])
        )
    return File("ecumaster.csv", text(lines), "sensors/tps1", "dbw/target")


def ecumaster_black() -> File:
    """EMU Black's text export: tabs, units in a row of their own."""
    head = ["TIME\tRPM\tTPS\tDBW Pos\tDBW Target\tDBW Out. DC\tLambda target", "s\trpm\t%\t%\t%\t%\tL"]
    return sheet("emublack.csv", head, "time rpm pedal position setpoint duty target_afr", "DBW Pos [%]",
                 "DBW Target [%]", "\t")  # fmt: skip


def hp_tuners() -> File:
    head = ["HP Tuners CSV Log File", "Version: 1.0", "", "[Log Information]", "Creation Time: 1/1/2026 10:00:00 AM",
            "Notes: ", "", "[Channel Information]", "0,12,17,2115,68,90",
            "Offset,Engine RPM (SAE),Throttle Position (SAE),Throttle Desired Angle,Air-Fuel Ratio Commanded,"
            "AEM 30-(03x0,2340)",
            "s,rpm,%,%,:1,AFR", "", "[Channel Data]"]  # fmt: skip
    body = []
    for k, row in enumerate(rows("time rpm position setpoint", ",", {"rpm": "%.0f"})):
        body.append(f"{row},14.1,14.2" if k % 10 == 0 else row)  # a channel that ticks seldom: shorter rows
    return File("hptuners.csv", text([*head, *body]), "Throttle Position (SAE) [%]", "Throttle Desired Angle [%]")


def aim() -> File:
    head = ["Format,AiM CSV File", "Session,Test", "Vehicle,none", "Racer,nobody", "Championship,", "Comment,",
            'Date,"Monday, May 5, 2025"', "Time,10:00 AM", "Sample Rate,50",
            f"Duration,{SECONDS:.3f}", "Segment,Session",
            "Beacon Markers,7.100,14.200", "Segment Times,0:07.100,0:07.100", "",
            "Time,GPS Speed,ECU RPM,ECU THROTTLE,ECU THROTTLE TARGET,LateralAcc", "s,km/h,rpm,%,%,g", ""]  # fmt: skip
    return sheet("aim.csv", head, "time rpm rpm position setpoint afr", "ECU THROTTLE [%]", "ECU THROTTLE TARGET [%]")


def motec() -> File:
    head = ['"Format","MoTeC CSV File",,,"Workbook",""', '"Venue","none",,,"Worksheet",""', '"Device","M150"',
            '"Comment","",,,"Session",""',
            '"Log Date","05/05/2025",,,"Origin Time","0.000","s"', '"Log Time","12:00:00",,,"Start Time","0.000","s"',
            '"Time","12:00:00"',
            '"Sample Rate","50.000","Hz",,"End Time","20.000","s"', '"Duration","20.000","s",,"Start Distance","0","m"',
            '"Range","entire outing",,,"End Distance","812","m"', '"Beacon Markers","7.1 14.2 "', "", "",
            '"Time","Engine Speed","Time","Throttle Pedal","Throttle Servo Bank 1 Position",'
            '"Throttle Servo Bank 1 Aim","Fuel Injector Primary Duty Cycle"',
            '"s","rpm","min","%","%","%","%"', "", ""]  # fmt: skip
    body = [",".join(f'"{cell}"' for cell in row.split(","))
            for row in rows("time rpm minutes pedal position setpoint injector", ",", {"minutes": "%.4f"})]  # fmt: skip
    return File(
        "motec.csv", text([*head, *body], "\r\n"), "Throttle Servo Bank 1 Position [%]", "Throttle Servo Bank 1 Aim [%]"
    )


def link() -> File:
    head = ["Time (s),Engine Speed (RPM),APS (Main) (%),TP (Main) (%),E-Throttle Target (%),Lambda Target (λ),"
            "E-Throttle DC (%)"]  # fmt: skip
    return sheet("link.csv", head, "time rpm pedal position setpoint target_afr duty", "TP (Main) (%)",
                 "E-Throttle Target (%)")  # fmt: skip


def maxxecu() -> File:
    """TPS is the pedal there."""
    head = ["Time;RPM;TPS;E-Throttle Position;E-Throttle Target;Lambda target"]
    return sheet("maxxecu.csv", head, "time rpm pedal position setpoint target_afr", "E-Throttle Position",
                 "E-Throttle Target", ";", ",")  # fmt: skip


def rusefi() -> File:
    head = ['"rusEFI 20260101"', '"Capture Date: Thu Jan 01 10:00:00 UTC 2026"',
            "Time\tRPM\tTPS\tThrottle pedal position\ttpsADC\tETB Target\tETB: Duty\tFuel: target AFR\tVBatt\tFan",
            "s\tRPM\t%\t%\tADC\t%\t%\tratio\tV\t"]  # fmt: skip
    body = [f"{row}\tOn" for row in rows("time rpm position pedal adc setpoint duty target_afr battery", "\t")]
    return File("rusefi.msl", text([*head, *body[:400], "MARK 000 - lap", *body[400:]]), "TPS [%]", "ETB Target [%]")


def fome() -> File:
    """Names parted by a colon, the group before it."""
    head = ['"FOME 20260101"', '"Capture Date: Thu Jan 01 10:00:00 UTC 2026"',
            "Time\tRPM\ttps1: Position\tPedal: Position\tETB: target\tETB: duty\tTarget AFR",
            "s\tRPM\t%\t%\t%\t%\tratio"]  # fmt: skip
    return sheet("fome.msl", head, "time rpm position pedal setpoint duty target_afr", "tps1: Position [%]",
                 "ETB: target [%]", "\t")  # fmt: skip


def megasquirt() -> File:
    """A cable throttle: no setpoint, no motor."""
    head = ['"MS1 code"', '"Capture Date: Thu Jan 01 00:00:00 2026"',
            "Time\tSecL\tRPM\ttpsADC\tTPS\tAFR Target\tDutyCycle1\tTPS DOT\tBattery V",
            "\tsec\trpm\tADC\t%\tO2\t\t%/s\tV"]  # fmt: skip
    keys = "time gear rpm adc position target_afr injector afr battery"
    return sheet("megasquirt.msl", head, keys, "TPS [%]", "", "\t")


def speeduino() -> File:
    head = ['"speeduino 202501"', "Time\tRPM\tTPS\tTPS ADC\tTarget AFR\tPulse Width\tIdle Duty",
            "s\trpm\t%\tADC\t\tms\t%"]  # fmt: skip
    return sheet("speeduino.msl", head, "time rpm position adc target_afr injector duty", "TPS [%]", "", "\t")


def iso() -> File:
    """Instants with a date, of a telematics box."""
    lines = ["timestamp,Engine RPM,Throttle Position (%),Commanded Throttle Actuator (%)"]
    body = rows("rpm position setpoint", ",")
    lines += [f"2026-01-01T{clock}Z,{row}" for clock, row in zip(clocks(), body, strict=True)]
    return File("iso.csv", text(lines), "Throttle Position (%)", "Commanded Throttle Actuator (%)")


def clock_and_half() -> File:
    """A clock of twelve hours that passes noon."""
    lines = ["Time,RPM,TPS,DBW Target"]
    for stamp, row in zip(clocks(43190.0), rows("rpm position setpoint", ","), strict=True):
        lines.append(f"{int(stamp[:2]) % 12 or 12}{stamp[2:]} {'AM' if stamp < '12' else 'PM'},{row}")
    return File("noon.csv", text(lines), "TPS", "DBW Target")


def stop_watch() -> File:
    """Minutes and seconds, as a spreadsheet shows a time, over the hour."""
    lines = ["Time,RPM,TPSValue,etbTarget,targetAFR"]
    body = rows("rpm position setpoint target_afr", ",")
    lines += [f"{clock[3:]},{row}" for clock, row in zip(clocks(43190.0), body, strict=True)]
    return File("watch.csv", text(lines), "TPSValue", "etbTarget")


def three_rows() -> File:
    """Long names, units, short names; a separator more at each end."""
    head = ["Time;Throttle valve position;Throttle target;Engine speed;", "ms;%;%;rpm;", "t;thr;thrsp;n;"]
    body = [f"{row};" for row in milliseconds("position setpoint rpm", ";")]
    return File("three.csv", text([*head, *body]), "Throttle valve position [%]", "Throttle target [%]")


def label_value() -> File:
    """A microcontroller's serial line, the first cut off, below PuTTY's own."""
    body = labelled("t,{us:.0f},tps,{y:.2f},target,{r:.2f}")
    return File("serial.csv", text(["=~=~= PuTTY log 2026.01.01 10:00:00 =~=~=", "get,28.1", *body]), "tps", "target")


def plotter() -> File:
    """The same for a serial plotter."""
    return File("plotter.txt", text(labelled("TPS:{y:.2f}\ttarget:{r:.2f}\ttime_ms:{ms:.0f}")), "TPS", "target")


def monitor() -> File:
    """A serial monitor, the unit behind each number, with a blank between them or not."""
    body = labelled("t: {ms:.0f} ms, TPS: {y:.2f}%, target: {r:.2f} %")
    return File("monitor.txt", text(body), "TPS [%]", "target [%]")


def savetxt() -> File:
    """numpy.savetxt with a header."""
    body = rows("time position setpoint", " ", dict.fromkeys(DRIVE, "%.18e"))
    return File("savetxt.txt", text(["# time_s TPS target", *body]), "TPS", "target", 1e-9)


def listed() -> File:
    """Names in a numbered list of comments, as MATLAB scripts and robots write them."""
    head = ["%% drive", "%  1    time [s]", "%  2    Throttle position [%]", "%  3    Throttle target [%]"]
    return sheet("listed.txt", head, "time position setpoint", "Throttle position [%]", "Throttle target [%]", "  ")


def me221() -> File:
    head = ("Time, Marker, RPM, Injector duty, TPS Raw, TPS, Current Target AFR, DBW PWM Duty, Target TPPS Err., "
            "Target TPPS, Throttle Pos. 1, Throttle Pos. 2, Calc. Pedal Pos.")  # fmt: skip
    keys = "time gear rpm injector adc pedal target_afr duty afr setpoint position position pedal"
    return sheet("me221.csv", [head], keys, "Throttle Pos. 1", "Target TPPS")


def romraider() -> File:
    """A Subaru's, semicolons and decimal commas."""
    head = ("Time (msec);Engine Speed (rpm);Throttle Opening Angle (%);Target Throttle Plate Position (%);"
            "Ignition Timing (degrees)")  # fmt: skip
    return File("romraider.csv", text([head, *milliseconds("rpm position setpoint afr", ";", ",")]),
                "Throttle Opening Angle (%)", "Target Throttle Plate Position (%)")  # fmt: skip


def ecux() -> File:
    """Bosch ME7 by its own names, milliseconds."""
    head = ["Time,Engine speed,Throttle plate angle,Throttle plate angle desired,Accelerator pedal position",
            "ms,1/min,%,%,%"]  # fmt: skip
    return File("ecux.csv", text([*head, *milliseconds("rpm position setpoint pedal", ",")]),
                "Throttle plate angle [%]", "Throttle plate angle desired [%]")  # fmt: skip


def obd() -> File:
    """A phone's log in UTF-16."""
    names = "Absolute Throttle Position (%)", "Commanded Throttle Actuator Control (%)"
    head = ["OBD Data Log", "Jan 1, 2026", f"Time(s), Engine RPM (RPM), {', '.join(names)}"]
    plain = text([*head, *rows("time rpm position setpoint", ", ")], "\r\n")
    return File("obd.csv", plain.decode().encode("utf-16"), *names)


def emtron() -> File:
    head = ["Emtron CSV Export", "ECU,KV8", "", "Time,Engine Speed,DBW1 Position,DBW1 Target,DBW1 Duty,Fuel Target",
            "(sec),(rpm),(%),(%),(%),(LA)"]  # fmt: skip
    return sheet("emtron.csv", head, "time rpm position setpoint duty target_afr", "DBW1 Position [%]",
                 "DBW1 Target [%]")  # fmt: skip


def pi_toolbox() -> File:
    head = ["PiToolboxVersionedASCIIDataSet", "Version\t2", "", "{OutingInformation}", "CarName\tnone",
            "FirstLapNumber\t0", "",
            "{ChannelBlock}", "Time\tecu_rpm[rpm]\tecu_tps[%]\tecu_throttle_target[%]\tecu_aps[%]"]  # fmt: skip
    body = rows("time rpm position setpoint pedal", "\t")
    return File("pi.txt", text([*head, *body, ""], "\r\n"), "ecu_tps[%]", "ecu_throttle_target[%]")


def spreadsheet() -> File:
    """A German spreadsheet in Windows-1252."""
    head = ["Prüffahrt 3", "", "Zeit in s;Drosselklappe in %;Drosselklappe Soll in %;Drehzahl in 1/min"]
    body = rows("time position setpoint rpm", ";", mark=",")
    return File("pruefung.csv", "\r\n".join([*head, *body, ""]).encode("cp1252"),
                "Drosselklappe in %", "Drosselklappe Soll in %")  # fmt: skip


def newcomer() -> File:
    """Five columns of a forum's log, without a unit."""
    return sheet("log.csv", ["time,TPS,target,duty,battery"], "time position setpoint duty battery", "TPS", "target")


def aem() -> File:
    head = ["Time [s],EngineSpeed[RPM],Throttle[%],DBW_Target[%],DBW_APP1[V],LambdaTarget[LA]"]
    return sheet("aem.csv", head, "time rpm position setpoint afr target_afr", "Throttle[%]", "DBW_Target[%]")


def percent_first() -> File:
    """A row of units that begins as a comment of MATLAB would."""
    return sheet("units.csv", ["TPS,Target,Time", "%,%,s"], "position setpoint time", "TPS [%]", "Target [%]")


FILES: tuple[Callable[[], File], ...] = (
    *(haltech, ecumaster, ecumaster_black, hp_tuners, aim, motec, link, maxxecu, rusefi, fome, megasquirt, speeduino),
    *(iso, clock_and_half, stop_watch, three_rows, label_value, plotter, monitor, savetxt, listed),
    *(me221, romraider, ecux, obd, emtron, pi_toolbox, spreadsheet, newcomer, aem, percent_first),
)
