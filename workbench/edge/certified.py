"""What calibration certificates (DCC) of the sensor and of a thermometer add to the budget of a bevel."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from workbench.artefacts import MilledEdge, Quantity, Term
from workbench.artefacts.evidence import SCALE
from workbench.certificate import (
    ERRORS,
    LENGTHS,
    RATIOS,
    TEMPERATURES,
    Asked,
    certified_errors,
    left_out,
    names_of,
)
from workbench.edge.column_errors import Linearity
from workbench.errors import InputError
from workbench.units import AnyArray

LINEARITY = Asked(("linearity", "linearitaet"), ERRORS, ("linear",))
SCALES = Asked(("scale", "scaling", "skalierung", "massstab"), ERRORS, ("scal", "skal", "massstab"))
THERMOMETER = Asked(
    ("error", "deviation", "fehler", "abweichung", "correction", "korrektion", "korrektur"),
    ("measurement", "mess", "indication", "anzeige", "temperatur"),
)
REFERENCE_C = 20.0  # ISO 1
STEEL_PER_K, STEEL_U_PER_K = 11.5e-6, 1e-6  # linear expansion, of unalloyed and low-alloyed steels
MOST_SCALE = 0.05  # that an instrument may be off
LASTS = math.inf  # mm along the edge


def certified_linearity(declared: Linearity, certificate: Path | None) -> Linearity:
    """The linearity that a sensor's certificate states, with its uncertainty; as declared where it states none."""
    errors = None if certificate is None else certified_errors(certificate, LINEARITY, LENGTHS)
    return declared if errors is None else declared._replace(rms_mm=math.hypot(errors.rms, errors.u))


def certified(
    edge: MilledEdge, sensor: Path | None, thermometer: Path | None, temperature_c: float | None
) -> MilledEdge:
    """The edge with what the certificates add, as far as there are any; what they hold beside it is in its warnings.

    Raises:
        InputError: a certificate without what it is for, or with what may be it; a thermometer without temperature.
    """
    unused: tuple[str, ...] = ()
    if thermometer is None and temperature_c is not None:
        unused += (f"{temperature_c:g} °C is not in u: expected thermometer_dcc, the certificate of what told it",)
    if sensor is not None:
        unused += left_out(sensor, SCALES, LINEARITY)
        edge = _with_scale(edge, sensor)
    if thermometer is not None:
        if temperature_c is None:
            raise InputError(str(thermometer), "expected temperature_c beside it: what the thermometer told")
        unused += left_out(thermometer, THERMOMETER)
        edge = _with_temperature(edge, temperature_c, thermometer)
    return replace(edge, warnings=(*edge.warnings, *unused))


def _with_scale(edge: MilledEdge, certificate: Path) -> MilledEdge:
    """The edge with the certified error of the profiler's scale in u; that of the other axis stays unshown.

    Values are not corrected: the certified error counts in full, beside its uncertainty.

    Raises:
        InputError: the certificate has neither scale nor linearity, or a scale that no sensor has.
    """
    errors = certified_errors(certificate, SCALES, RATIOS)
    if errors is None:
        if certified_errors(certificate, LINEARITY, LENGTHS) is None:
            expected = f"expected a quantity 'scale' or 'linearity' of the sensor (there: {names_of(certificate)})"
            raise InputError(str(certificate), expected)
        return edge
    off = errors.largest
    if abs(off) > MOST_SCALE:
        raise InputError(str(certificate), f"expected a scale within {MOST_SCALE:g} of 1, found {1.0 + off:g}")
    u = math.hypot(off, errors.u)
    cost = next((one for one in edge.unseen if one.name == "scale"), None)
    if cost is None:
        return edge
    source = f"scale of the profiler, certificate {errors.identifier}"
    share = u / SCALE
    return replace(
        edge,
        root=_with(edge.root, source, share * cost.costs["root_mm"]),
        bevel=_with(edge.bevel, source, share * cost.costs["bevel_deg"]),
    )


def _with_temperature(edge: MilledEdge, temperature_c: float, certificate: Path) -> MilledEdge:
    """The edge with its part's temperature in u of the root face: a steel part, whose size holds at 20 °C.

    Raises:
        InputError: the certificate has no error of the thermometer.
    """
    errors = certified_errors(certificate, THERMOMETER, TEMPERATURES)
    if errors is None:
        expected = f"expected a quantity 'basic_measurementError' of the thermometer (there: {names_of(certificate)})"
        raise InputError(str(certificate), expected)
    off = temperature_c - REFERENCE_C
    by_thermometer = STEEL_PER_K * math.hypot(errors.largest, errors.u)
    share = math.sqrt((STEEL_PER_K * off) ** 2 + (STEEL_U_PER_K * off) ** 2 + by_thermometer**2)
    source = f"temperature of the part, {temperature_c:g} °C, certificate {errors.identifier}"
    return replace(edge, root=_with(edge.root, source, share * abs(edge.root.value)))


def _with(size: Quantity, source: str, u: AnyArray | float) -> Quantity:
    return replace(size, terms=(*size.terms, Term(source, "B", u, LASTS)))
