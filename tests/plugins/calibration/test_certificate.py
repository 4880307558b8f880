"""The sphere's diameter and its uncertainty out of a calibration certificate (DCC)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.plugins.calibration import conftest as spheres
from workbench.api import certified_length
from workbench.certificate import RATIOS, TEMPERATURES, certified_errors
from workbench.edge.certified import SCALES, THERMOMETER
from workbench.errors import InputError
from workbench.plugins import calibration

HEAD = (
    '<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si">'
    "<dcc:administrativeData><dcc:coreData><dcc:uniqueIdentifier>K-17</dcc:uniqueIdentifier></dcc:coreData>"
    "</dcc:administrativeData><dcc:measurementResults><dcc:measurementResult><dcc:influenceConditions>"
    "<dcc:influenceCondition><dcc:data><dcc:quantity><dcc:name><dcc:content>room diameter</dcc:content></dcc:name>"
    r"<si:real><si:value>4</si:value><si:unit>\metre</si:unit></si:real></dcc:quantity></dcc:data>"
    "</dcc:influenceCondition></dcc:influenceConditions><dcc:results><dcc:result><dcc:data>"
)
TAIL = (
    "</dcc:data></dcc:result></dcc:results></dcc:measurementResult></dcc:measurementResults>"
    "</dcc:digitalCalibrationCertificate>"
)
EXPANDED = (
    "<si:expandedUnc><si:uncertainty>{}</si:uncertainty><si:coverageFactor>2</si:coverageFactor>"
    "<si:coverageProbability>0.95</si:coverageProbability></si:expandedUnc>"
)
UNIVARIATE = (
    "<si:measurementUncertaintyUnivariate><si:expandedMU><si:valueExpandedMU>{}</si:valueExpandedMU>"
    "<si:coverageFactor>2</si:coverageFactor></si:expandedMU></si:measurementUncertaintyUnivariate>"
)
STANDARD = (
    "<si:measurementUncertaintyUnivariate><si:standardMU><si:valueStandardMU>{}</si:valueStandardMU></si:standardMU>"
    "</si:measurementUncertaintyUnivariate>"
)


def quantity(value: str, unit: str, uncertainty: str, name: str = "Diameter of the sphere", kind: str = "") -> str:
    told = f' refType="{kind}"' if kind else ""
    return (
        f"<dcc:quantity{told}><dcc:name><dcc:content lang='en'>{name}</dcc:content></dcc:name>"
        f"<si:real><si:value>{value}</si:value><si:unit>{unit}</si:unit>{uncertainty}</si:real></dcc:quantity>"
    )


GOOD = quantity("25.4012", r"\milli\metre", EXPANDED.format("0.0008"))


@pytest.mark.parametrize(
    "written",
    [
        GOOD,
        quantity("0.0254012", r"\metre", UNIVARIATE.format("0.8e-6")),
        f"<dcc:list>{quantity('25401.2', chr(92) + 'micro' + chr(92) + 'metre', STANDARD.format('0.4'))}</dcc:list>",
        quantity("25.4012", r"\milli\metre", EXPANDED.format("0.0008"), "D", "geometry_sphereDiameter"),
        quantity("25.4012", r"\milli\metre", EXPANDED.format("0.0008"), "Kugeldurchmesser"),
        quantity("25.4012", r"\milli\metre", EXPANDED.format("0.0008"), "Durchmesser der Keramik-Prüfkugel"),
        quantity("25.4012", r"\milli\metre", EXPANDED.format("0.0008"), "Diameter of calibration sphere No. 3"),
        GOOD + quantity("0.0003", r"\milli\metre", EXPANDED.format("0.0001"), "Roundness"),
        GOOD + quantity("7", r"\kilogram", "", "Mass"),
    ],
)
def test_a_diameter_is_read(written: str, tmp_path: Path) -> None:
    file = tmp_path / "sphere.xml"
    file.write_text(HEAD + written + TAIL)
    found = certified_length(file, ("diameter", "durchmesser"))
    assert len(found.left_out) == written.count("<dcc:quantity") - 1
    assert (found.value_mm, found.u_mm) == pytest.approx((25.4012, 0.0004), rel=1e-9)
    assert found.identifier == "K-17"


SCALE = [
    *("Scale", "Scale factor along x", "Lot 3, Skalierung von z", "Error of the scale", "Scale z"),
    *("Maßstabsfehler", "Skalierungsfaktor", "Abweichungen des Maßstabs"),
]
NO_SCALE = ["scale division", "division of the scale", "Scaleability", "Temperature scale", "Full scale", "No scale"]


@pytest.mark.parametrize(
    ("name", "kind", "told"),
    [
        *((name, "", True) for name in SCALE),
        *((name, "", False) for name in NO_SCALE),
        *(("z", kind, True) for kind in ("scaleZ", "optical_axialScale")),
        ("z", "optical_scaleDivision", False),
    ],
)
def test_a_quantity_is_told_by_known_words_alone(name: str, kind: str, told: bool, tmp_path: Path) -> None:
    file = tmp_path / "sensor.xml"
    file.write_text(HEAD + quantity("1.001", r"\one", EXPANDED.format("0.0002"), name, kind) + TAIL)
    assert (certified_errors(file, SCALES, RATIOS) is not None) is told


DEVIATION = ["mean deviation of the indication", "Messabweichung", "Indication error", "Korrektur"]
NO_DEVIATION = ["Experimental standard deviation", "Std deviation", "Permissible deviation", "Bath stability deviation"]


@pytest.mark.parametrize(
    ("name", "told"), [*((name, True) for name in DEVIATION), *((name, False) for name in NO_DEVIATION)]
)
def test_a_standard_deviation_is_no_deviation(name: str, told: bool, tmp_path: Path) -> None:
    file = tmp_path / "thermometer.xml"
    file.write_text(HEAD + quantity("0.1", r"\kelvin", EXPANDED.format("0.02"), name) + TAIL)
    assert (certified_errors(file, THERMOMETER, TEMPERATURES) is not None) is told


BAD = {
    "entities": ("<!DOCTYPE a [<!ENTITY b 'c'>]>" + HEAD + GOOD + TAIL, "without document type or entities"),
    "another file": (
        "<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/hostname'>]>" + HEAD + GOOD + TAIL,
        "without document type or entities",
    ),
    "other XML": ("<robot/>", "expected the root dcc:digitalCalibrationCertificate, found robot"),
    "cut short": ((HEAD + GOOD + TAIL)[:-40], "expected a certificate"),
    "no uncertainty": (HEAD + quantity("25.4", r"\milli\metre", "") + TAIL, "expected an uncertainty"),
    "in degrees": (HEAD + quantity("25.4", r"\degree", EXPANDED.format(1)) + TAIL, "expected a value in one of"),
    "two": (HEAD + GOOD + GOOD + TAIL, r"found 2 \(there: Diameter of the sphere"),
    "none": (HEAD + GOOD.replace("Diameter", "Mass") + TAIL, r"found 0 \(there: Mass of the sphere\)"),
    "no number": (HEAD + GOOD.replace("25.4012", "NaN") + TAIL, "expected a number as value, found 'NaN'"),
    "no factor": (
        HEAD + GOOD.replace("<si:coverageFactor>2</si:coverageFactor>", "") + TAIL,
        "expected a number above 0 as coverageFactor",
    ),
}


@pytest.mark.parametrize(("content", "said"), BAD.values(), ids=BAD)
def test_what_is_no_such_certificate_is_refused(content: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "sphere.xml"
    file.write_text(content)
    with pytest.raises(InputError, match=said):
        certified_length(file, ("diameter",))


def test_a_certificate_takes_the_place_of_what_the_recording_states(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    ball = spheres.recording(rng, spheres.cell(rng, *spheres.postures(rng, 9)))
    arcs = calibration.circles(ball)
    stated = arcs.sphere_diameter_mm
    file = tmp_path / "sphere.xml"

    def found(by: float) -> float:
        written = quantity(f"{stated + by:.6f}", r"\milli\metre", EXPANDED.format("0.0008"))
        file.write_text(HEAD + written + TAIL)
        return calibration.hand_eye(arcs, ball, sphere_certificate=file)[1].sphere_radius_mm

    assert found(0.02) - found(0.0) == pytest.approx(0.01, abs=0.002)  # 0.4 um against what the circles tell
    with pytest.raises(InputError, match="another sphere"):
        found(1.0)
