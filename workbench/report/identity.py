"""Whose measurement it is, as the first page says it: part, people, instruments, calibrations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from workbench.artefacts import Part, PartNames
from workbench.artefacts.parts import iso_date
from workbench.errors import one_line
from workbench.report.template import render

SHOWN = 60  # characters of a name
DAYS_A_YEAR = 365.25


def identity_html(part: Part) -> str:
    """What is known of the part, what is not, and how to set it."""
    missing = [field.name for field in fields(PartNames) if getattr(part, field.name) is None]
    return render("identity.html.j2", rows=list(identity_rows(part)), missing=missing)


def identity_rows(part: Part) -> Iterator[tuple[str, str, bool]]:
    """Name, value and whether it is known."""
    for name, value in (
        ("Part", part.part_id),
        ("Drawing", part.drawing),
        ("Recorded", part.recorded_at and part.recorded_at.replace("T", " ")),
        ("Operator", part.operator),
    ):
        yield name, shortened(value) if value else "unknown", bool(value)
    yield "Sensor", instrument(part.sensor, part.sensor_serial), part.sensor is not None
    calibrated = dated(part.sensor_calibrated_at, part.recorded_at)
    yield "Sensor calibrated", calibrated or "unknown", bool(calibrated)
    yield "Robot", instrument(part.robot, part.robot_serial), part.robot is not None
    yield "Hand-eye calibration", hand_eye(part), part.hand_eye is not None
    if part.simulated is not None:
        yield "Kind of part", "simulated: no real part was measured" if part.simulated else "real", True


def instrument(name: str | None, serial: str | None) -> str:
    """An instrument and its serial number."""
    number = f"serial number {shortened(serial)}" if serial else "serial number unknown"
    return f"{shortened(name)}, {number}" if name else f"unknown, {number}" if serial else "unknown"


def hand_eye(part: Part) -> str:
    """The hand-eye calibration in use: from where, of when, how good."""
    if part.hand_eye is None:
        return "unknown"
    when = dated(part.hand_eye_calibrated_at, part.recorded_at) or "date unknown"
    good = f"{part.hand_eye_u_mm:.3f} mm over the field of view" if part.hand_eye_u_mm is not None else "unknown"
    return f"{shortened(part.hand_eye)}, {when}; u {good}"


def dated(day: str | None, of: str | None) -> str:
    """A date, and how long before the recording it was; '' where there is none."""
    if day is None:
        return ""
    then, now = iso_date(day), iso_date(of) if of else None
    if then is None or now is None:
        return day.partition("T")[0]
    days = (now - then).days
    age = f"{days} days" if abs(days) < DAYS_A_YEAR else f"{days / DAYS_A_YEAR:.1f} years"
    return f"{then}, {age} before" if days >= 0 else f"{then}, after the recording"


def shortened(text: str | None) -> str:
    """A name out of a file on one line, cut where it is long."""
    text = one_line(text or "")
    return text if len(text) <= SHOWN else text[: SHOWN - 1] + "…"
