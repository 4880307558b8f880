"""Certificates (DCC) of sensor and thermometer in the budget of a bevel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.recordings import frames
from workbench import cloud, edge, scan
from workbench.artefacts import Cloud, MilledEdge
from workbench.errors import InputError

ROOT = Path(__file__).parents[2]
SCALE = 1.0006
HEAD = (
    '<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si">'
    "<dcc:administrativeData><dcc:coreData><dcc:uniqueIdentifier>K-17</dcc:uniqueIdentifier></dcc:coreData>"
    "</dcc:administrativeData><dcc:measurementResults><dcc:measurementResult><dcc:results><dcc:result><dcc:data>"
)
TAIL = (
    "</dcc:data></dcc:result></dcc:results></dcc:measurementResult></dcc:measurementResults>"
    "</dcc:digitalCalibrationCertificate>"
)
LISTED = (
    '<dcc:quantity refType="{}"><dcc:name><dcc:content>{}</dcc:content></dcc:name><si:hybrid><si:realListXMLList>'
    "<si:valueXMLList>{}</si:valueXMLList><si:unitXMLList>{}</si:unitXMLList>"
    "<si:measurementUncertaintyUnivariateXMLList><si:expandedMUXMLList><si:valueExpandedMUXMLList>{}"
    "</si:valueExpandedMUXMLList><si:coverageFactorXMLList>2</si:coverageFactorXMLList></si:expandedMUXMLList>"
    "</si:measurementUncertaintyUnivariateXMLList></si:realListXMLList></si:hybrid></dcc:quantity>"
)


def certificate(file: Path, *quantities: str) -> Path:
    file.write_text(HEAD + "".join(quantities) + TAIL)
    return file


@pytest.fixture(scope="module")
def points() -> Cloud:
    """Every second frame of a third of the shipped part."""
    whole = scan.read(recording=ROOT / "data/synthetic/milled_edge.h5")
    return cloud.denoise(scan.fuse(frames(whole, np.arange(0, len(whole.time_s) // 3, 2))))


@pytest.fixture(scope="module")
def plain(points: Cloud) -> MilledEdge:
    return edge.segment(points)


def test_the_scale_is_a_source_as_large_as_what_it_does(points: Cloud, plain: MilledEdge, tmp_path: Path) -> None:
    file = certificate(tmp_path / "s.xml", LISTED.format("", "scale of z", f"{SCALE} 1.0002", r"\one", "0.0001"))
    found = edge.segment(points, sensor_dcc=file)
    (source,) = set(found.root.u_by_source) - set(plain.root.u_by_source)
    assert source == "scale of the profiler, certificate K-17"
    assert {one.name for one in plain.unseen} == {one.name for one in found.unseen}  # of x nothing is certified
    wrong = [
        edge.segment(replace(points, **{axis: (SCALE * getattr(points, axis)).astype(np.float32)}))
        for axis in ("x_mm", "z_mm")
    ]
    for size in ("root", "bevel"):
        u = float(np.nanmedian(getattr(found, size).u_by_source[source]))
        moved = max(abs(float(np.nanmedian(getattr(one, size).value - getattr(plain, size).value))) for one in wrong)
        assert u == pytest.approx(moved, rel=0.2)


def test_linearity_takes_the_place_of_what_is_declared(points: Cloud, plain: MilledEdge, tmp_path: Path) -> None:
    known = LISTED.format("", "Linearity of the range", "3 -4", r"\micro\metre", "2")
    found = edge.segment(points, sensor_dcc=certificate(tmp_path / "s.xml", known))
    declared = tmp_path / "sensor.json"
    declared.write_text('{"linearity_mm": 0.003674}')  # hypot of the rms, 3.536 um, and u, 1 um
    assert found.root.u == pytest.approx(edge.segment(points, sensor=declared).root.u, rel=1e-3, nan_ok=True)
    assert np.nanmedian(found.bevel.u) > np.nanmedian(plain.bevel.u)


def test_a_warm_part_is_in_u_of_the_root_face(points: Cloud, tmp_path: Path) -> None:
    known = LISTED.format("basic_measurementError", "Abweichung", "0.1 -0.3", r"\kelvin", "0.2 0.1")
    found = edge.segment(points, thermometer_dcc=certificate(tmp_path / "t.xml", known), temperature_c=120.0)
    u = found.root.u_by_source["temperature of the part, 120 °C, certificate K-17"] / found.root.value
    assert np.nanmedian(u) == pytest.approx(100.0 * 11.5e-6, rel=0.01)  # of steel, from 20 to 120 °C
    assert not any("temperature" in source for source in found.bevel.u_by_source)


@pytest.mark.parametrize(
    ("given", "quantity", "told"),
    [
        (
            "sensor_dcc",
            ("", "mass", "1", r"\kilogram", "0.1"),
            "expected a quantity 'scale' or 'linearity'.*there: mass",
        ),
        ("sensor_dcc", ("", "scale", "1.4", r"\one", "0.1"), "expected a scale within 0.05 of 1, found 1.4"),
        ("sensor_dcc", ("", "scale", "1.0", r"\one", "0.1 0.1 0.1"), "for each of 1 values"),
        ("sensor_dcc", ("", "linearity", "1", r"\second", "0.1"), "expected a value in one of"),
        ("thermometer_dcc", ("", "mass", "1", r"\kilogram", "0.1"), "basic_measurementError"),
        ("thermometer_dcc", ("basic_measurementError", "", "1", r"\kelvin", "0.1"), "expected temperature_c"),
        (
            "sensor_dcc",
            ("", "Linearity of the mapped scale", "1", r"\metre", "0.1"),
            "what is 'Linearity of the mapped",
        ),
    ],
)
def test_what_says_nothing_to_the_budget_is_refused(
    points: Cloud, tmp_path: Path, given: str, quantity: tuple[str, ...], told: str
) -> None:
    warm = {} if "temperature_c" in told or given == "sensor_dcc" else {"temperature_c": 20.0}
    with pytest.raises(InputError, match=told):
        edge.segment(points, **{given: certificate(tmp_path / "k.xml", LISTED.format(*quantity))}, **warm)


def test_what_a_certificate_holds_beside_is_named(points: Cloud, plain: MilledEdge, tmp_path: Path) -> None:
    """A scale of 2 % was dropped without a word beside a linearity."""
    known, other = LISTED.format("", "Linearity", "1 -1", r"\micro\metre", "1"), (r"\one", "0.001")
    for name in ("Scale factor error", "Maßstabsfehler"):
        used = edge.segment(
            points, sensor_dcc=certificate(tmp_path / "s.xml", known, LISTED.format("", name, "1.02", *other))
        )
        assert any(source.startswith("scale of the profiler") for source in used.root.u_by_source)
        assert not set(used.warnings) - set(plain.warnings)
    scale = LISTED.format("", "Scale", "1.02", *other)
    for name in ("Linearity, full scale", "Linearity in the full measuring range"):
        whole = certificate(tmp_path / "s.xml", scale, LISTED.format("", name, "1 -1", r"\micro\metre", "1"))
        assert not set(edge.segment(points, sensor_dcc=whole).warnings) - set(plain.warnings)
    beside = certificate(tmp_path / "s.xml", known, LISTED.format("", "Gain", "1.02", *other))
    assert "certificate K-17: 'Gain', 1.02 one, is not used" in edge.segment(points, sensor_dcc=beside).warnings
    for name in ("Rescaled gain", "Scale coefficient", "Scale error of the standard range"):
        unclear = certificate(tmp_path / "s.xml", known, LISTED.format("", name, "1.02", *other))
        with pytest.raises(InputError, match=f"what is '{name}'"):
            edge.segment(points, sensor_dcc=unclear)


def test_a_temperature_without_its_thermometer_is_said_to_be_in_no_u(points: Cloud, plain: MilledEdge) -> None:
    told = set(edge.segment(points, temperature_c=31.0).warnings) - set(plain.warnings)
    assert told == {"31 °C is not in u: expected thermometer_dcc, the certificate of what told it"}
