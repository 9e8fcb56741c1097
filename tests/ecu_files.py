"""Logs as programs of engine computers and loggers write them: synthetic drives in the makers' layouts.

Nothing here knows the package, and no file is a real car's: layouts are those that public readers and writers of each
program agree on, the numbers are `drive()`'s. Every file holds traps: signals of the engine under names that resemble
the throttle's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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
            "battery": 13.8 + 0.1 * np.sin(3 * time),
            "duty": 18.0 + 6.0 * np.cos(2 * np.pi * 0.7 * time),
            "adc": np.round(100 + 7.0 * foot(time - 0.06))}  # fmt: skip


DRIVE = drive()


def rmse() -> float:
    """Of the drive, per cent."""
    return float(np.sqrt(np.mean((DRIVE["position"] - DRIVE["setpoint"]) ** 2)))


def rows(keys: Sequence[str], separator: str, forms: Sequence[str] = (), mark: str = ".") -> list[str]:
    """The drive's rows; every cell in its form."""
    forms = forms or ["%.2f"] * len(keys)
    cells = zip(*(DRIVE[key] for key in keys), strict=True)
    return [separator.join(form % x for form, x in zip(forms, row, strict=True)).replace(".", mark) for row in cells]


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
    keys = ["time", "rpm", "pedal", "position", "setpoint", "duty", "target_afr"]
    return File(
        "emublack.csv", text([*head, *rows(keys, "\t", ["%.3f", *["%.2f"] * 6])]), "DBW Pos [%]", "DBW Target [%]"
    )


def hp_tuners() -> File:
    head = ["HP Tuners CSV Log File", "Version: 1.0", "", "[Log Information]", "Creation Time: 1/1/2026 10:00:00 AM",
            "Notes: ", "", "[Channel Information]", "0,12,17,2115,68,90",
            "Offset,Engine RPM (SAE),Throttle Position (SAE),Throttle Desired Angle,Air-Fuel Ratio Commanded,"
            "AEM 30-(03x0,2340)",
            "s,rpm,%,%,:1,AFR", "", "[Channel Data]"]  # fmt: skip
    body = []
    for k, row in enumerate(rows(["time", "rpm", "position", "setpoint"], ",", ["%.3f", "%.0f", "%.2f", "%.2f"])):
        body.append(f"{row},14.1,14.2" if k % 10 == 0 else row)  # a channel that ticks seldom: shorter rows
    return File("hptuners.csv", text([*head, *body]), "Throttle Position (SAE) [%]", "Throttle Desired Angle [%]")


def aim() -> File:
    head = ["Format,AiM CSV File", "Session,Test", "Vehicle,none", "Racer,nobody", "Championship,", "Comment,",
            'Date,"Monday, May 5, 2025"', "Time,10:00 AM", "Sample Rate,50",
            f"Duration,{SECONDS:.3f}", "Segment,Session",
            "Beacon Markers,7.100,14.200", "Segment Times,0:07.100,0:07.100", "",
            "Time,GPS Speed,ECU RPM,ECU THROTTLE,ECU THROTTLE TARGET,LateralAcc", "s,km/h,rpm,%,%,g", ""]  # fmt: skip
    keys = ["time", "rpm", "rpm", "position", "setpoint", "afr"]
    return File(
        "aim.csv",
        text([*head, *rows(keys, ",", ["%.3f", *["%.2f"] * 5])]),
        "ECU THROTTLE [%]",
        "ECU THROTTLE TARGET [%]",
    )


def motec() -> File:
    head = ['"Format","MoTeC CSV File",,,"Workbook",""', '"Venue","none",,,"Worksheet",""', '"Device","M150"',
            '"Comment","",,,"Session",""',
            '"Log Date","05/05/2025",,,"Origin Time","0.000","s"', '"Log Time","12:00:00",,,"Start Time","0.000","s"',
            '"Sample Rate","50.000","Hz",,"End Time","20.000","s"', '"Duration","20.000","s",,"Start Distance","0","m"',
            '"Range","entire outing",,,"End Distance","812","m"', '"Beacon Markers","7.1 14.2 "', "", "",
            '"Time","Engine Speed","Throttle Pedal","Throttle Servo Bank 1 Position","Throttle Servo Bank 1 Aim",'
            '"Fuel Injector Primary Duty Cycle"', '"s","rpm","%","%","%","%"', "", ""]  # fmt: skip
    body = [",".join(f'"{cell}"' for cell in row.split(","))
            for row in rows(["time", "rpm", "pedal", "position", "setpoint", "injector"], ",",
                            ["%.3f", *["%.2f"] * 5])]  # fmt: skip
    return File(
        "motec.csv", text([*head, *body], "\r\n"), "Throttle Servo Bank 1 Position [%]", "Throttle Servo Bank 1 Aim [%]"
    )


def link() -> File:
    head = [
        "Time (s),Engine Speed (RPM),APS (Main) (%),TP (Main) (%),E-Throttle Target (%),Lambda Target (λ),"
        "E-Throttle DC (%)"
    ]
    keys = ["time", "rpm", "pedal", "position", "setpoint", "target_afr", "duty"]
    return File(
        "link.csv", text([*head, *rows(keys, ",", ["%.3f", *["%.2f"] * 6])]), "TP (Main) (%)", "E-Throttle Target (%)"
    )


def maxxecu() -> File:
    """TPS is the pedal there."""
    head = ["Time;RPM;TPS;E-Throttle Position;E-Throttle Target;Lambda target"]
    keys = ["time", "rpm", "pedal", "position", "setpoint", "target_afr"]
    return File(
        "maxxecu.csv",
        text([*head, *rows(keys, ";", ["%.3f", *["%.2f"] * 5], ",")]),
        "E-Throttle Position",
        "E-Throttle Target",
    )


def rusefi() -> File:
    head = ['"rusEFI 20260101"', '"Capture Date: Thu Jan 01 10:00:00 UTC 2026"',
            "Time\tRPM\tTPS\tThrottle pedal position\ttpsADC\tETB Target\tETB: Duty\tFuel: target AFR\tVBatt\tFan",
            "s\tRPM\t%\t%\tADC\t%\t%\tratio\tV\t"]  # fmt: skip
    keys = ["time", "rpm", "position", "pedal", "adc", "setpoint", "duty", "target_afr", "battery"]
    body = [f"{row}\tOn" for row in rows(keys, "\t", ["%.3f", *["%.2f"] * 8])]
    return File("rusefi.msl", text([*head, *body[:400], "MARK 000 - lap", *body[400:]]), "TPS [%]", "ETB Target [%]")


def fome() -> File:
    """Names parted by a colon, the group before it."""
    head = ['"FOME 20260101"', '"Capture Date: Thu Jan 01 10:00:00 UTC 2026"',
            "Time\tRPM\ttps1: Position\tPedal: Position\tETB: target\tETB: duty\tTarget AFR",
            "s\tRPM\t%\t%\t%\t%\tratio"]  # fmt: skip
    body = rows(["time", "rpm", "position", "pedal", "setpoint", "duty", "target_afr"], "\t", ["%.3f", *["%.2f"] * 6])
    return File("fome.msl", text([*head, *body]), "tps1: Position [%]", "ETB: target [%]")


def megasquirt() -> File:
    """A cable throttle: no setpoint, no motor."""
    head = ['"MS1 code"', '"Capture Date: Thu Jan 01 00:00:00 2026"',
            "Time\tSecL\tRPM\ttpsADC\tTPS\tAFR Target\tDutyCycle1\tTPS DOT\tBattery V",
            "\tsec\trpm\tADC\t%\tO2\t\t%/s\tV"]  # fmt: skip
    keys = ["time", "gear", "rpm", "adc", "position", "target_afr", "injector", "afr", "battery"]
    return File("megasquirt.msl", text([*head, *rows(keys, "\t", ["%.3f", *["%.2f"] * 8])]), "TPS [%]", "")


def speeduino() -> File:
    head = [
        '"speeduino 202501"',
        "Time\tRPM\tTPS\tTPS ADC\tTarget AFR\tPulse Width\tIdle Duty",
        "s\trpm\t%\tADC\t\tms\t%",
    ]
    keys = ["time", "rpm", "position", "adc", "target_afr", "injector", "duty"]
    return File("speeduino.msl", text([*head, *rows(keys, "\t", ["%.3f", *["%.2f"] * 6])]), "TPS [%]", "")


def iso() -> File:
    """Instants with a date, of a telematics box."""
    lines = ["timestamp,Engine RPM,Throttle Position (%),Commanded Throttle Actuator (%)"]
    body = rows(["rpm", "position", "setpoint"], ",")
    lines += [f"2026-01-01T{clock}Z,{row}" for clock, row in zip(clocks(), body, strict=True)]
    return File("iso.csv", text(lines), "Throttle Position (%)", "Commanded Throttle Actuator (%)")


def clock_and_half() -> File:
    """A clock of twelve hours that passes noon."""
    lines = ["Time,RPM,TPS,DBW Target"]
    for stamp, row in zip(clocks(43190.0), rows(["rpm", "position", "setpoint"], ","), strict=True):
        lines.append(f"{int(stamp[:2]) % 12 or 12}{stamp[2:]} {'AM' if stamp < '12' else 'PM'},{row}")
    return File("noon.csv", text(lines), "TPS", "DBW Target")


def stop_watch() -> File:
    """Minutes and seconds, as a spreadsheet shows a time, over the hour."""
    lines = ["Time,RPM,TPSValue,etbTarget,targetAFR"]
    body = rows(["rpm", "position", "setpoint", "target_afr"], ",")
    lines += [f"{clock[3:]},{row}" for clock, row in zip(clocks(43190.0), body, strict=True)]
    return File("watch.csv", text(lines), "TPSValue", "etbTarget")


def three_rows() -> File:
    """Long names, units, short names; a separator more at each end."""
    head = ["Time;Throttle valve position;Throttle target;Engine speed;", "ms;%;%;rpm;", "t;thr;thrsp;n;"]
    body = [
        f"{1e3 * t:.0f};{row};"
        for t, row in zip(DRIVE["time"], rows(["position", "setpoint", "rpm"], ";"), strict=True)
    ]
    return File("three.csv", text([*head, *body]), "Throttle valve position [%]", "Throttle target [%]")


def label_value() -> File:
    """A microcontroller's serial line, the first cut off, below PuTTY's own."""
    body = [
        f"t,{1e6 * t:.0f},tps,{y:.2f},target,{r:.2f}"
        for t, y, r in zip(*(DRIVE[k] for k in ("time", "position", "setpoint")), strict=True)
    ]
    return File("serial.csv", text(["=~=~= PuTTY log 2026.01.01 10:00:00 =~=~=", "get,28.1", *body]), "tps", "target")


def plotter() -> File:
    """The same for a serial plotter."""
    body = [
        f"TPS:{y:.2f}\ttarget:{r:.2f}\ttime_ms:{1e3 * t:.0f}"
        for t, y, r in zip(*(DRIVE[k] for k in ("time", "position", "setpoint")), strict=True)
    ]
    return File("plotter.txt", text(body), "TPS", "target")


def monitor() -> File:
    """A serial monitor, the unit behind each number, with a blank between them or not."""
    body = [
        f"t: {1e3 * t:.0f} ms, TPS: {y:.2f}%, target: {r:.2f} %"
        for t, y, r in zip(*(DRIVE[k] for k in ("time", "position", "setpoint")), strict=True)
    ]
    return File("monitor.txt", text(body), "TPS [%]", "target [%]")


def savetxt() -> File:
    """numpy.savetxt with a header."""
    body = rows(["time", "position", "setpoint"], " ", ["%.18e"] * 3)
    return File("savetxt.txt", text(["# time_s TPS target", *body]), "TPS", "target", 1e-9)


def listed() -> File:
    """Names in a numbered list of comments, as MATLAB scripts and robots write them."""
    head = ["%% drive", "%  1    time [s]", "%  2    Throttle position [%]", "%  3    Throttle target [%]"]
    return File("listed.txt", text([*head, *rows(["time", "position", "setpoint"], "  ", ["%.3f", "%.2f", "%.2f"])]),
                "Throttle position [%]", "Throttle target [%]")  # fmt: skip


def me221() -> File:
    head = ("Time, Marker, RPM, Injector duty, TPS Raw, TPS, Current Target AFR, DBW PWM Duty, Target TPPS Err., "
            "Target TPPS, Throttle Pos. 1, Throttle Pos. 2, Calc. Pedal Pos.")  # fmt: skip
    keys = [
        "time",
        "gear",
        "rpm",
        "injector",
        "adc",
        "pedal",
        "target_afr",
        "duty",
        "afr",
        "setpoint",
        "position",
        "position",
        "pedal",
    ]
    return File("me221.csv", text([head, *rows(keys, ",", ["%.3f", *["%.2f"] * 12])]), "Throttle Pos. 1", "Target TPPS")


def romraider() -> File:
    """A Subaru's, semicolons and decimal commas."""
    head = ("Time (msec);Engine Speed (rpm);Throttle Opening Angle (%);Target Throttle Plate Position (%);"
            "Ignition Timing (degrees)")  # fmt: skip
    body = [
        f"{1e3 * t:.0f};{row}"
        for t, row in zip(DRIVE["time"], rows(["rpm", "position", "setpoint", "afr"], ";", mark=","), strict=True)
    ]
    return File(
        "romraider.csv", text([head, *body]), "Throttle Opening Angle (%)", "Target Throttle Plate Position (%)"
    )


def ecux() -> File:
    """Bosch ME7 by its own names, milliseconds."""
    head = ["Time,Engine speed,Throttle plate angle,Throttle plate angle desired,Accelerator pedal position",
            "ms,1/min,%,%,%"]  # fmt: skip
    body = [
        f"{1e3 * t:.0f},{row}"
        for t, row in zip(DRIVE["time"], rows(["rpm", "position", "setpoint", "pedal"], ","), strict=True)
    ]
    return File("ecux.csv", text([*head, *body]), "Throttle plate angle [%]", "Throttle plate angle desired [%]")


def obd() -> File:
    """A phone's log in UTF-16."""
    lines = [
        "OBD Data Log",
        "Jan 1, 2026",
        "Time(s), Engine RPM (RPM), Absolute Throttle Position (%), Commanded Throttle Actuator Control (%)",
    ]
    lines += [
        row.replace(",", ", ") for row in rows(["time", "rpm", "position", "setpoint"], ",", ["%.3f", *["%.2f"] * 3])
    ]
    return File(
        "obd.csv",
        text(lines, "\r\n").decode().encode("utf-16"),
        "Absolute Throttle Position (%)",
        "Commanded Throttle Actuator Control (%)",
    )


def emtron() -> File:
    head = [
        "Emtron CSV Export",
        "ECU,KV8",
        "",
        "Time,Engine Speed,DBW1 Position,DBW1 Target,DBW1 Duty,Fuel Target",
        "(sec),(rpm),(%),(%),(%),(LA)",
    ]
    keys = ["time", "rpm", "position", "setpoint", "duty", "target_afr"]
    return File(
        "emtron.csv", text([*head, *rows(keys, ",", ["%.3f", *["%.2f"] * 5])]), "DBW1 Position [%]", "DBW1 Target [%]"
    )


def pi_toolbox() -> File:
    head = ["PiToolboxVersionedASCIIDataSet", "Version\t2", "", "{OutingInformation}", "CarName\tnone",
            "FirstLapNumber\t0", "",
            "{ChannelBlock}", "Time\tecu_rpm[rpm]\tecu_tps[%]\tecu_throttle_target[%]\tecu_aps[%]"]  # fmt: skip
    body = rows(["time", "rpm", "position", "setpoint", "pedal"], "\t", ["%.3f", *["%.2f"] * 4])
    return File("pi.txt", text([*head, *body, ""], "\r\n"), "ecu_tps[%]", "ecu_throttle_target[%]")


def spreadsheet() -> File:
    """A German spreadsheet in Windows-1252."""
    head = ["Prüffahrt 3", "", "Zeit in s;Drosselklappe in %;Drosselklappe Soll in %;Drehzahl in 1/min"]
    body = rows(["time", "position", "setpoint", "rpm"], ";", ["%.3f", *["%.2f"] * 3], ",")
    return File("pruefung.csv", "\r\n".join([*head, *body, ""]).encode("cp1252"),
                "Drosselklappe in %", "Drosselklappe Soll in %")  # fmt: skip


def newcomer() -> File:
    """Five columns of a forum's log, without a unit."""
    body = rows(["time", "position", "setpoint", "duty", "battery"], ",", ["%.3f", *["%.2f"] * 4])
    return File("log.csv", text(["time,TPS,target,duty,battery", *body]),
                "TPS", "target")  # fmt: skip


def aem() -> File:
    head = ["Time [s],EngineSpeed[RPM],Throttle[%],DBW_Target[%],DBW_APP1[V],LambdaTarget[LA]"]
    keys = ["time", "rpm", "position", "setpoint", "afr", "target_afr"]
    return File("aem.csv", text([*head, *rows(keys, ",", ["%.3f", *["%.2f"] * 5])]), "Throttle[%]", "DBW_Target[%]")


def percent_first() -> File:
    """A row of units that begins as a comment of MATLAB would."""
    body = rows(["position", "setpoint", "time"], ",", ["%.2f", "%.2f", "%.3f"])
    return File("units.csv", text(["TPS,Target,Time", "%,%,s", *body]), "TPS [%]", "Target [%]")


FILES: tuple[Callable[[], File], ...] = (
    *(haltech, ecumaster, ecumaster_black, hp_tuners, aim, motec, link, maxxecu, rusefi, fome, megasquirt, speeduino),
    *(iso, clock_and_half, stop_watch, three_rows, label_value, plotter, monitor, savetxt, listed),
    *(me221, romraider, ecux, obd, emtron, pi_toolbox, spreadsheet, newcomer, aem, percent_first),
)
