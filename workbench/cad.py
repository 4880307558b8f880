"""CAD models as STEP (ISO 10303): their bevelled edges and their surface, by gmsh (Open CASCADE, extra [cad]).

Gmsh runs as a process of its own: damaged files crash it, and its licence is the GPL. `python -P cad.py FILE OUT`;
OUT is `edges.json` or `mesh.npz`. The file's unit is in it: all comes out in mm.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from workbench.children import confine, library, read_by
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm
from workbench.storage import regular_file
from workbench.units import DEG, Float, Int, Shaped

SUFFIXES = (".step", ".stp")
MOST_BYTES = 2**28
SECONDS = 120
SQUARE_DEG = 1.0  # by which a root face may be out of square, the surfaces out of parallel
CORNER_DEG = 5.0  # beyond it pieces do not go on
LEAST_BEVEL_DEG, MOST_BEVEL_DEG = 5.0, 75.0
STEADY_MM, STEADY_DEG = 0.05, 0.1  # by which one section may vary along an edge
STATIONS = 12  # along a piece, at which the section is looked at
SAMPLES = 201  # along a curve
CHORD_MM, TURN_RAD = 0.002, 0.35  # by which triangles leave the surface, at most
MOST_NAMED = 12


@dataclass(frozen=True, slots=True, eq=False)
class NominalEdge:
    """A bevelled edge of a model, in its frame. Sizes are the smallest and the greatest along the edge."""

    points_mm: Shaped[Float, "p 3"]  # of the lower edge, in order of t = m x n
    upper_side: Shaped[Float, "p 3"]  # m: from the lower to the upper side
    thickness_mm: tuple[float, float]
    root_mm: tuple[float, float]
    bevel_deg: tuple[float, float]

    @property
    def length_mm(self) -> float:
        """Along the points."""
        return float(chords_mm(self.points_mm).sum())

    def summary(self) -> str:
        """The edge in words."""
        ends = " to ".join("({:.6g}, {:.6g}, {:.6g})".format(*self.points_mm[k] + 0.0) for k in (0, -1))
        thickness, root, bevel = (_span(one) for one in (self.thickness_mm, self.root_mm, self.bevel_deg))
        sizes = f"thickness {thickness} mm, root face {root} mm, bevel {bevel} deg"
        return f"{self.length_mm:.2f} mm from {ends}: {sizes}"


def nominal_edges(path: Path) -> tuple[NominalEdge, ...]:
    """The bevelled edges of a STEP file's solids, longest first.

    An edge is where a root face meets the lower surface at a right angle; beyond the root face a bevel of 5 to 75 deg
    reaches an upper surface parallel to the lower. Pieces without a corner between them and of one section are one.

    Raises:
        InputError: gmsh is not installed; no whole STEP file; no solid; none of its edges is bevelled.
    """
    with _read(path, "edges.json") as out:
        found = json.loads(out.read_text())
    if not found["solids"]:
        raise InputError(str(path), "expected a solid, found surfaces or curves alone: export the body, not its faces")
    keys = ("thickness_mm", "root_mm", "bevel_deg")
    edges = [
        NominalEdge(np.array(one["points_mm"]), np.array(one["upper_side"]), *(tuple(one[key]) for key in keys))
        for one in found["edges"]
    ]
    if not edges:
        raise InputError(
            str(path),
            f"expected an edge with a root face square to the surfaces and a bevel of {LEAST_BEVEL_DEG:g} to "
            f"{MOST_BEVEL_DEG:g} deg up to a parallel surface, found none among {found['curves']} edges: "
            "is the bevel modelled, does a root face stay, is it one bevel?",
        )
    return tuple(sorted(edges, key=lambda one: -one.length_mm))


def nominal_edge(path: Path, number: int | None) -> NominalEdge:
    """The edge that is meant, of one section.

    Raises:
        InputError: several edges and no number, no such number, a section that varies; else as `nominal_edges`.
    """
    edges = nominal_edges(path)
    if (number is None and len(edges) > 1) or not 1 <= (number or 1) <= len(edges):
        there = "; ".join(f"{k}: {one.summary()}" for k, one in enumerate(edges[:MOST_NAMED], 1))
        wanted = "edge_number of one edge" if number is None else f"edge_number from 1 to {len(edges)}, found {number}"
        raise InputError(str(path), f"expected {wanted}; there are {there}")
    edge = edges[(number or 1) - 1]
    if max(np.ptp(edge.thickness_mm), np.ptp(edge.root_mm)) > STEADY_MM or np.ptp(edge.bevel_deg) > STEADY_DEG:
        raise InputError(str(path), f"expected one section along the edge, found {edge.summary()}")
    return edge


def surface(path: Path) -> tuple[Float, Int]:
    """The surface of a STEP file as vertices (n, 3) and triangles (k, 3), outwards, within 0.002 mm of it.

    Raises:
        InputError: gmsh is not installed, or no whole STEP file.
    """
    with _read(path, "mesh.npz") as out, np.load(out) as found:
        return np.round(found["points"], 9) + 0.0, np.asarray(found["triangles"], np.int64)


def _span(pair: tuple[float, float]) -> str:
    low, high = (f"{one:.2f}".rstrip("0").rstrip(".") for one in pair)
    return low if low == high else f"{low} to {high}"


@contextmanager
def _read(path: Path, made: str) -> Iterator[Path]:
    """What the child made of a file, while the block lasts."""
    if regular_file(path).st_size > MOST_BYTES:
        raise InputError(str(path), f"expected at most {MOST_BYTES} bytes")
    try:
        with read_by(__file__, path, made, SECONDS) as (status, said, out):
            if status or not out.exists():
                why = said.strip().splitlines()[-1:] if status == 1 else []
                raise InputError(str(path), f"expected a whole STEP file: {(why or ['its reader crashed'])[0]}")
            yield out
    except subprocess.TimeoutExpired:
        raise InputError(str(path), f"expected a STEP file: not read within {SECONDS} s") from None


# The child.


class _Piece(NamedTuple):
    """One curve of the lower edge, in order of t."""

    points: Float
    upper: Float
    sections: Float  # (k, 3): thickness, root, bevel in deg
    bevels: Int  # (k,) faces


def main() -> int:
    """Read FILE, write OUT. What goes wrong is said in one line."""
    file, out = sys.argv[1:]
    confine(os.path.getsize(file))
    gmsh = library("gmsh")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    try:
        gmsh.model.occ.importShapes(file)
        gmsh.model.occ.synchronize()
        if out.endswith(".npz"):
            points, triangles = _triangles(gmsh)
            np.savez(out, points=points, triangles=triangles)
        else:
            Path(out).write_text(json.dumps(_edges(gmsh)))
    except Exception as error:  # of gmsh: no other type
        print((str(error).splitlines() or [type(error).__name__])[0].replace(f"'{file}'", "it"))
        return 1
    return 0


def _triangles(gmsh: Any) -> tuple[Float, Int]:
    gmsh.option.setNumber("Mesh.StlLinearDeflection", CHORD_MM)
    gmsh.option.setNumber("Mesh.StlLinearDeflectionRelative", 0)
    gmsh.option.setNumber("Mesh.StlAngularDeflection", TURN_RAD)
    gmsh.model.mesh.importStl()
    names, points, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(names)
    _, _, corners = gmsh.model.mesh.getElements(2)
    used = np.searchsorted(names[order], np.concatenate([np.empty(0, names.dtype), *corners]))
    return points.reshape(-1, 3)[order], used.reshape(-1, 3)


def _edges(gmsh: Any) -> dict[str, Any]:
    solids = [tag for _, tag in gmsh.model.getEntities(3)]
    curves = gmsh.model.getEntities(1)
    found = [line for solid in solids for line in _chained(_plates([*_Solid(gmsh, solid).pieces()]))]
    edges = [
        {
            "points_mm": line.points.tolist(),
            "upper_side": line.upper.tolist(),
            **{
                key: [float(line.sections[:, k].min()), float(line.sections[:, k].max())]
                for k, key in enumerate(("thickness_mm", "root_mm", "bevel_deg"))
            },
        }
        for line in found
    ]
    return {"solids": len(solids), "curves": len(curves), "edges": edges}


class _Solid:
    """A solid's faces and curves. Gmsh turns the normals of its faces outwards."""

    def __init__(self, gmsh: Any, solid: int) -> None:
        self._model = gmsh.model
        own = {abs(tag) for _, tag in self._model.getBoundary([(3, solid)], oriented=False)}
        self._curves_of = {face: [abs(tag) for _, tag in self._model.getBoundary([(2, face)])] for face in own}
        self._faces_of: dict[int, list[int]] = {}
        for face, curves in self._curves_of.items():
            for curve in set(curves):
                self._faces_of.setdefault(curve, []).append(face)

    def pieces(self) -> Iterator[_Piece]:
        """Curves along which a bevelled edge's root face meets the lower surface."""
        for curve, faces in self._faces_of.items():
            if len(faces) == 2:
                for lower, root in (faces, faces[::-1]):
                    if (piece := self._piece(curve, lower, root)) is not None:
                        yield piece

    def _piece(self, curve: int, lower: int, root: int) -> _Piece | None:
        low, high = (float(one[0]) for one in self._model.getParametrizationBounds(1, curve))
        points = self._at(curve, np.linspace(low, high, SAMPLES))
        stations = self._at(curve, low + (high - low) * (np.arange(STATIONS) + 0.5) / STATIONS)
        sections = []
        for place in stations:
            if (section := self._section(place, curve, lower, root)) is None:
                return None
            sections.append(section)
        upper = -np.array([self._normal(lower, one) for one in points])
        along = np.cross(upper[SAMPLES // 2], self._normal(root, points[SAMPLES // 2]))
        if (points[SAMPLES // 2 + 1] - points[SAMPLES // 2 - 1]) @ along < 0.0:
            points, upper = points[::-1], upper[::-1]
        if self._model.getType(1, curve) == "Line":
            points, upper = points[[0, -1]], upper[[0, -1]]
        *sizes, bevels = zip(*sections, strict=True)
        return _Piece(points, upper, np.transpose(sizes), np.array(bevels))

    def _section(self, place: Float, curve: int, lower: int, root: int) -> tuple[float, float, float, int] | None:
        """Thickness, root face, bevel in deg, and its face, square to the edge; None: it is no bevelled edge."""
        n, m = self._normal(root, place), -self._normal(lower, place)
        if abs(n @ m) > math.sin(SQUARE_DEG * DEG):
            return None
        t = np.cross(m, n)
        first = self._across(root, curve, place, t, m)
        if first is None:
            return None
        second = self._across(first.face, first.curve, first.place, t, m)
        if second is None:
            return None
        face = self._normal(first.face, first.place)
        bevel = math.atan2(face @ m, face @ n) / DEG
        parallel = self._normal(second.face, second.place) @ m > math.cos(SQUARE_DEG * DEG)
        if not parallel or not LEAST_BEVEL_DEG <= bevel <= MOST_BEVEL_DEG:
            return None
        return float((second.place - place) @ m), float(np.linalg.norm(first.place - place)), bevel, first.face

    def _across(self, face: int, curve: int, place: Float, t: Float, m: Float) -> _Beyond | None:
        """Where, square to t and towards m, the face ends next, and which one follows."""
        nearest: tuple[float, _Beyond] | None = None
        for other in set(self._curves_of[face]) - {curve}:
            beyond = [one for one in self._faces_of[other] if one != face]
            for point in self._crossings(other, place, t) if len(beyond) == 1 else ():
                far = float(np.linalg.norm(point - place))
                if (point - place) @ m > 0.0 and (nearest is None or far < nearest[0]):
                    nearest = far, _Beyond(beyond[0], other, point)
        return None if nearest is None else nearest[1]

    def _crossings(self, curve: int, place: Float, t: Float) -> Float:
        """Points (k, 3) of the curve in the plane through `place` that is square to t."""
        low, high = (float(one[0]) for one in self._model.getParametrizationBounds(1, curve))
        at = np.linspace(low, high, SAMPLES)
        off = (self._at(curve, at) - place) @ t
        k = np.flatnonzero((off[:-1] * off[1:] <= 0.0) & (off[:-1] != off[1:]))
        return self._at(curve, at[k] + (at[1] - at[0]) * off[k] / (off[k] - off[k + 1]))

    def _at(self, curve: int, parameters: Float) -> Float:
        return np.reshape(self._model.getValue(1, curve, list(parameters)), (-1, 3))

    def _normal(self, face: int, place: Float) -> Float:
        return np.array(self._model.getNormal(face, self._model.getParametrization(2, face, place)))


class _Beyond(NamedTuple):
    """What follows where a face ends."""

    face: int
    curve: int
    place: Float


def _plates(pieces: list[_Piece]) -> list[_Piece]:
    """Of two readings of one bevel that with the smaller thickness: a plate is thinner than wide."""
    least: dict[int, float] = {}
    for one in pieces:
        for face in one.bevels.tolist():
            least[face] = min(least.get(face, math.inf), one.sections[:, 0].min())
    return [one for one in pieces if one.sections[:, 0].min() <= least[int(one.bevels[0])] + STEADY_MM]


def _chained(pieces: list[_Piece]) -> Iterator[_Piece]:
    """Pieces that go on from one another without a corner, with the same section, as one."""
    left = pieces
    while left:
        line, left = left[0], left[1:]
        grown = True
        while grown:
            grown = False
            for k, one in enumerate(left):
                pair = (line, one) if _goes_on(line, one) else (one, line) if _goes_on(one, line) else None
                if pair is not None:
                    a, b = pair
                    more = b._replace(points=b.points[1:], upper=b.upper[1:])
                    line = _Piece(*(np.concatenate(both) for both in zip(a, more, strict=True)))
                    left, grown = left[:k] + left[k + 1 :], True
                    break
        yield line


def _goes_on(a: _Piece, b: _Piece) -> bool:
    ends = a.points[-1] - a.points[-2], b.points[1] - b.points[0]
    turn = (ends[0] @ ends[1]) / (np.linalg.norm(ends[0]) * np.linalg.norm(ends[1]))
    same = np.abs(a.sections.mean(axis=0) - b.sections.mean(axis=0)) <= (STEADY_MM, STEADY_MM, STEADY_DEG)
    near = np.linalg.norm(a.points[-1] - b.points[0]) < 1e-3
    return bool(near and same.all() and turn > math.cos(CORNER_DEG * DEG))


if __name__ == "__main__":
    sys.exit(main())
