"""Calibration certificates: one length with its uncertainty out of a DCC (PTB's XML, its values in the D-SI).

Schemas 2 and 3: `dcc:measurementResults`, in it `dcc:quantity` with `si:real`. What is looked for is told by the
quantity's `refType` or its names; results only count, not the conditions under which they were made.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from workbench.errors import InputError
from workbench.storage import regular_file

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
MAX_BYTES = 2**24  # with pictures and a PDF in it, as base 64
DECLARES = re.compile(rb"<!(DOCTYPE|ENTITY)", re.IGNORECASE)
PREFIXES = {"": 1e3, r"\kilo": 1e6, r"\centi": 1e1, r"\milli": 1.0, r"\micro": 1e-3, r"\nano": 1e-6}  # mm of a metre
UNCERTAINTIES = (  # in the D-SI's second and first version: value, coverage factor (none: a standard uncertainty)
    ("measurementUncertaintyUnivariate/expandedMU", "valueExpandedMU", "coverageFactor"),
    ("measurementUncertaintyUnivariate/standardMU", "valueStandardMU", None),
    ("expandedUnc", "uncertainty", "coverageFactor"),
)


@dataclass(frozen=True, slots=True)
class Certified:
    """A length from a certificate."""

    value_mm: float
    u_mm: float  # standard uncertainty
    identifier: str  # of the certificate


def certified_length(path: Path, words: tuple[str, ...]) -> Certified:
    """The one length of a certificate that is told by one of the words, in any case.

    Raises:
        InputError: no such file, no DCC, no or several such lengths, one without an uncertainty or a unit of length.
    """
    root = _parsed(path)
    found = [one for one in _results(root) if _is_told(one, words)]
    if len(found) != 1:
        shown = "; ".join(_names(one) for one in (found or list(_results(root)))[:6]) or "none"
        expected = f"expected one quantity '{words[0]}' with a real value among the results"
        raise InputError(str(path), f"{expected}, found {len(found)}" + f" (there: {shown})")
    reals = [_length_mm(real, path) for real in found[0].iter(f"{SI}real")]
    lengths = [one for one in reals if one is not None]
    if not lengths:
        raise InputError(f"{path}: {_names(found[0])}", "expected a value in metres, as \\metre or \\milli\\metre")
    identifier = root.findtext(f"{DCC}administrativeData/{DCC}coreData/{DCC}uniqueIdentifier", "").strip()
    return Certified(*lengths[0], identifier)


def _parsed(path: Path) -> ElementTree.Element:
    """The root of a certificate. What declares entities or a document type is refused before it is parsed."""
    if regular_file(path).st_size > MAX_BYTES:
        raise InputError(str(path), f"expected a certificate of at most {MAX_BYTES} bytes")
    try:
        content = path.read_bytes()
        if content[:2] in (b"\xff\xfe", b"\xfe\xff") or DECLARES.search(content):
            raise InputError(str(path), "expected a certificate (DCC) in UTF-8 without document type or entities")
        root = ElementTree.fromstring(content)
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(str(path), f"expected a certificate (DCC, XML): {error}") from None
    if root.tag != f"{DCC}digitalCalibrationCertificate":
        name = str(root.tag)[:60]
        raise InputError(str(path), f"expected the root dcc:digitalCalibrationCertificate, found {name}")
    return root


def _results(root: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Quantities that are results, in lists of them too."""
    for data in root.iterfind(f"{DCC}measurementResults/{DCC}measurementResult/{DCC}results/{DCC}result/{DCC}data"):
        todo = list(data)[::-1]
        while todo:
            one = todo.pop()
            if one.tag == f"{DCC}quantity" and one.find(f".//{SI}real") is not None:
                yield one
            elif one.tag == f"{DCC}list":
                todo += list(one)[::-1]


def _names(quantity: ElementTree.Element) -> str:
    told = [each.text or "" for each in quantity.iterfind(f"{DCC}name/{DCC}content")]
    return " / ".join(one.strip() for one in (*told, quantity.get("refType", "")) if one.strip()) or "without a name"


def _is_told(quantity: ElementTree.Element, words: tuple[str, ...]) -> bool:
    said = _names(quantity).casefold()
    return any(word in said for word in words)


def _length_mm(real: ElementTree.Element, path: Path) -> tuple[float, float] | None:
    """Value and standard uncertainty; None where the unit is not one of length."""
    unit = real.findtext(f"{SI}unit", "").strip()
    prefix, metre, rest = unit.partition(r"\metre")
    if not metre or rest or prefix not in PREFIXES:
        return None
    where = f"{path}: si:real in {unit}"
    value, u = _number(real, f"{SI}value", where), None
    for place, name, factor in UNCERTAINTIES:
        stated = real.find("/".join(f"{SI}{part}" for part in place.split("/")))
        if stated is not None:
            u = _number(stated, f"{SI}{name}", where) / (_number(stated, f"{SI}{factor}", where) if factor else 1.0)
            break
    if u is None:
        raise InputError(where, "expected an uncertainty: without one the certificate says nothing to the budget")
    return PREFIXES[prefix] * value, PREFIXES[prefix] * u


def _number(element: ElementTree.Element, tag: str, where: str) -> float:
    """A number above 0."""
    text = element.findtext(tag, "").strip()
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise InputError(where, f"expected a number above 0 as {tag.rpartition('}')[2]}, found {text[:40]!r}")
    return number
