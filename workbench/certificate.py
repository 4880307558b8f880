"""Calibration certificates: values with their uncertainty out of a DCC (PTB's XML, its values in the D-SI).

Schemas 2 and 3: `dcc:measurementResults`, in it `dcc:quantity` with `si:real` or `si:realListXMLList`. What is looked
for is what the quantity's `refType` or one of its names speaks of in known words alone: 'scale error of z' is a scale,
'scale division' is none. Results only count, not the conditions under which they were made; those left out are named.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from workbench.errors import InputError
from workbench.storage import regular_file
from workbench.strict_json import MAX_BYTES

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
DECLARES = re.compile(rb"<!(DOCTYPE|ENTITY)", re.IGNORECASE)
LENGTHS = {  # in mm
    rf"{prefix}\metre": value
    for prefix, value in (("", 1e3), (r"\centi", 1e1), (r"\milli", 1.0), (r"\micro", 1e-3), (r"\nano", 1e-6))
}
TEMPERATURES = {r"\kelvin": 1.0, r"\degreecelsius": 1.0, r"\milli\kelvin": 1e-3}  # differences, in K
RATIOS = {r"\one": 1.0, r"\percent": 1e-2, r"\ppm": 1e-6}
UNCERTAINTIES = (  # in the D-SI's second and first version: value, coverage factor (none: a standard uncertainty)
    ("measurementUncertaintyUnivariate/expandedMU", "valueExpandedMU", "coverageFactor"),
    ("measurementUncertaintyUnivariate/standardMU", "valueStandardMU", None),
    ("expandedUnc", "uncertainty", "coverageFactor"),
)
ERRORS = ("error", "deviation", "factor", "fehler", "abweichung", "faktor")  # of what they are told of: scale error
# Words that change nothing in what a name speaks of, as numbers and single letters; those of other quantities.
FILLERS = (
    "of|an|the|in|along|across|at|for|with|and|der|des|die|das|von|vom|im|bei|am|axis|axes|achse|direction|"
    "richtung|relativ|absolut|non|nicht|max|maximum|mean|mittler|measured|calibrated|gemessen|kalibriert|"
    "reference|referenz|sensor|profiler|laser|scanner|instrument|thermometer|sphere|ball|kugel|range|"
    "messbereich|full|measuring|lot|nr|mm|basic|math|geometry|optical|axial"
)
APART = re.compile(
    "division|teilung|standard ?(?:deviation|error|abweichung|fehler)|uncertainty|unsicherheit|repeatability|"
    "wiederholbar|temperature coefficient|temperaturkoeffizient"
)
OF_A_BALL = ("calibration", "kalibrier", "master", "pruef", "ceramic", "keramik", "steel", "stahl", "no", "number")
CAMEL = re.compile("_|(?<=[a-z])(?=[A-Z])")  # between the words of a refType
UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue"})  # the fourth, ß, folds with the case


class Asked(NamedTuple):
    """What is looked for: words (folded: 'massstab') of which a name holds one, others that it may hold beside them."""

    words: tuple[str, ...]
    fillers: tuple[str, ...] = ()
    stems: tuple[str, ...] = ()  # a name with one of these that is not understood is refused


class Certified(NamedTuple):
    """A length from a certificate."""

    value_mm: float
    u_mm: float  # standard uncertainty
    identifier: str  # of the certificate
    left_out: tuple[str, ...] = ()  # its other results, each in a sentence


class Errors(NamedTuple):
    """Errors of an instrument at all points of its calibration, in the unit that was asked for."""

    largest: float  # of either sign
    rms: float
    u: float  # the largest standard uncertainty
    identifier: str


def certified_length(path: Path, words: tuple[str, ...]) -> Certified:
    """The one length of a certificate that is told by one of the words, in any case.

    Raises:
        InputError: no such file, no DCC, no or several such lengths, one without an uncertainty or a unit of length.
    """
    root, asked = _parsed(path), Asked(words, OF_A_BALL)
    points = _points(_the_one(root, asked, path), LENGTHS, path)
    value, u = points[0]
    if len(points) > 1 or not value > 0.0:
        raise InputError(f"{path}: {words[0]}", f"expected one length above 0, found {len(points)}, {value:g} mm")
    return Certified(value, u, _identifier(root), left_out(path, asked))


def certified_errors(path: Path, asked: Asked, units: Mapping[str, float]) -> Errors | None:
    """The errors of an instrument that are asked for; None: its certificate has no such quantity.

    units: what each unit of the D-SI is in the unit that is asked for.

    Raises:
        InputError: no such file, no DCC, several such quantities, one without an uncertainty or in another unit.
    """
    root = _parsed(path)
    if not any(_matches(one, asked) for one in _results(root)):
        return None
    value, u = zip(*_points(_the_one(root, asked, path), units, path), strict=True)
    if units is RATIOS and min(value) > 0.5:  # ratios, not deviations from one
        value = tuple(one - 1.0 for one in value)
    rms = math.sqrt(sum(one**2 for one in value) / len(value))
    return Errors(max(value, key=abs), rms, max(u), _identifier(root))


def left_out(path: Path, *asked: Asked) -> tuple[str, ...]:
    """Every result of a certificate that is none of what was asked for, with its value.

    Raises:
        InputError: no such file, no DCC, or a result that may be what was asked for and is not understood.
    """
    root = _parsed(path)
    others = [one for one in _results(root) if not any(_matches(one, each) for each in asked)]
    for one in others:
        said = " ".join(_said(one))
        if any(stem in said for each in asked for stem in each.stems) and not APART.search(said):
            expected = f"expected a name in known words, as '{asked[0].words[0]} error': what is '{_names(one)}'?"
            raise InputError(str(path), f"{expected} It would be left out")
    return tuple(f"certificate {_identifier(root)}: '{_names(one)}', {_value(one)}, is not used" for one in others)


def _value(quantity: ElementTree.Element) -> str:
    real, many = next(_reals(quantity))
    parts = (real.findtext(f"{SI}{tag}{many}", "").replace("\\", " ").split() for tag in ("value", "unit"))
    return " ".join(" ".join(words)[:40] for words in parts)


def names_of(path: Path) -> str:
    """The quantities among a certificate's results, in words."""
    return _listed([*_results(_parsed(path))])


def _listed(quantities: list[ElementTree.Element]) -> str:
    return "; ".join(map(_names, quantities[:6])) or "none"


def _the_one(root: ElementTree.Element, asked: Asked, path: Path) -> ElementTree.Element:
    found = [one for one in _results(root) if _matches(one, asked)]
    if len(found) != 1:
        expected = f"expected one quantity '{asked.words[0]}' with a real value among the results, found {len(found)}"
        raise InputError(str(path), f"{expected} (there: {_listed(found or [*_results(root)])})")
    return found[0]


def _identifier(root: ElementTree.Element) -> str:
    return root.findtext(f"{DCC}administrativeData/{DCC}coreData/{DCC}uniqueIdentifier", "").strip()


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
            if one.tag == f"{DCC}quantity" and any(True for _ in _reals(one)):
                yield one
            elif one.tag == f"{DCC}list":
                todo += list(one)[::-1]


def _names(quantity: ElementTree.Element) -> str:
    names = [each.text or "" for each in quantity.iterfind(f"{DCC}name/{DCC}content")]
    return " / ".join(one.strip() for one in (*names, quantity.get("refType", "")) if one.strip()) or "without a name"


def _matches(quantity: ElementTree.Element, asked: Asked) -> bool:
    """Whether a `refType` or a name speaks of what is asked for and of nothing else: 'Lot 3, scale error of z' does.

    Plurals, cases and compounds of known words are known: 'Maßstabsfehler'.
    """
    said = _said(quantity)
    known = re.compile(f"(?:(?:{'|'.join((*asked.words, *asked.fillers, FILLERS))})(?:e?[nrs]|e)?)+")
    matches = (any(word in one for word in asked.words) and all(map(known.fullmatch, one.split())) for one in said)
    return any(matches) and not APART.search(" ".join(said))


def _said(quantity: ElementTree.Element) -> list[str]:
    """The words, folded, of each `refType` and each name; one longer than any known is two."""
    names = (one.text or "" for one in quantity.iterfind(f"{DCC}name/{DCC}content"))
    texts = (*quantity.get("refType", "").split(), *names)
    folded = (CAMEL.sub(" ", one).casefold().translate(UMLAUTS) for one in texts)
    return [" ".join(re.findall(r"[^\W\d_]{2,40}", one)).replace("full scale", "full range") for one in folded]


def _reals(quantity: ElementTree.Element) -> Iterator[tuple[ElementTree.Element, str]]:
    """Values of a quantity, one or a list, in each unit that it is told in; and what a list's tags end in."""
    for many in ("", "XMLList"):
        for real in quantity.iter(f"{SI}real" + ("List" + many if many else "")):
            yield real, many


def _points(quantity: ElementTree.Element, units: Mapping[str, float], path: Path) -> list[tuple[float, float]]:
    """Values and standard uncertainties in the first unit that is known."""
    for real, many in _reals(quantity):
        unit_names = {unit.strip() for unit in real.findtext(f"{SI}unit{many}", "").split()}
        if len(unit_names) != 1 or (unit := unit_names.pop()) not in units:
            continue
        where = f"{path}: {_names(quantity)} in {unit}"
        values = _numbers(real, f"value{many}", where)
        u = _uncertainties(real, many, len(values), where)
        return [(units[unit] * value, units[unit] * one) for value, one in zip(values, u, strict=True)]
    raise InputError(f"{path}: {_names(quantity)}", f"expected a value in one of {', '.join(units)}")


def _uncertainties(real: ElementTree.Element, many: str, count: int, where: str) -> list[float]:
    for place, name, factor in UNCERTAINTIES:
        stated = real.find("/".join(f"{SI}{part}{many}" for part in place.split("/")))
        if stated is None:
            continue
        u = _numbers(stated, f"{name}{many}", where, positive=True)
        by = _numbers(stated, f"{factor}{many}", where, positive=True) if factor else [1.0]
        if len(u) not in (1, count) or len(by) not in (1, count):
            raise InputError(where, f"expected an uncertainty and a coverage factor for each of {count} values")
        full = (one if len(one) == count else one * count for one in (u, by))
        return [a / b for a, b in zip(*full, strict=True)]
    raise InputError(where, "expected an uncertainty: without one the certificate says nothing to the budget")


def _numbers(element: ElementTree.Element, tag: str, where: str, *, positive: bool = False) -> list[float]:
    """The numbers in an element, one or more."""
    text = element.findtext(f"{SI}{tag}", "").strip()
    try:
        numbers = [float(one) for one in text.split()]
    except ValueError:
        numbers = []
    if not numbers or not all(math.isfinite(one) and (one > 0.0 or not positive) for one in numbers):
        what = "a number above 0" if positive else "a number"
        raise InputError(where, f"expected {what} as {tag}, found {text[:40]!r}")
    return numbers
