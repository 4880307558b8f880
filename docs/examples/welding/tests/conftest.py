"""Values as the stages of workbench hand them on, made by hand."""

import numpy as np
import pytest

from workbench.api import (
    Cutter,
    EdgeProfile,
    Inspection,
    Layer,
    Moves,
    PathGate,
    Postures,
    Quantity,
    Requirements,
    Section,
    Toolpath,
)

ROOT_U_MM, BEVEL_U_DEG = 0.01, 0.05


@pytest.fixture
def inspect():
    """An inspection with the root faces and bevel angles given, a section every 10 mm; None: hidden."""

    def make(root_mm, bevel_deg):
        n = len(root_mm)
        s = 10.0 * np.arange(n)
        position = np.outer(s, [1.0, 0.0, 0.0])
        sections = tuple(
            Section(
                i + 1,
                s[i],
                position[i],
                *np.eye(3),
                {
                    "root_mm": Quantity.of("root_mm", np.array(root_mm[i], float), {"ends": ROOT_U_MM}),
                    "bevel_deg": Quantity.of("bevel_deg", np.array(bevel_deg[i], float), {"directions": BEVEL_U_DEG}),
                },
                "pass",
                "",
                np.arange(3),
            )
            for i in range(n)
        )
        root, bevel = (np.array([np.nan if x is None else x for x in values]) for values in (root_mm, bevel_deg))
        profile = EdgeProfile(s, position, root, np.full(n, ROOT_U_MM), bevel, np.full(n, BEVEL_U_DEG))
        return Inspection(sections, profile, Requirements(), 1.645, "pass", "", "whole edge")

    return make


@pytest.fixture
def moves():
    """Six moves in a work object, the third along an arc, turned by up to nearly half a turn."""
    k = 6
    rng = np.random.default_rng(3)
    position = np.cumsum(rng.uniform(1, 9, (k, 3)), axis=0)
    q = rng.normal(size=(k, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    circular = np.arange(k) == 2
    via, via_q = np.full((k, 3), np.nan), np.full((k, 4), np.nan)
    via[2], via_q[2] = position[1:3].mean(axis=0) + np.array([0, 0, 1]), q[2]
    flags = np.ones(k, bool)
    layer = Layer(1, 0.0, np.arange(k, dtype=float), position, q, np.ones(k), flags, flags, np.ones(k))
    base_from_workobject = np.eye(4)
    base_from_workobject[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    base_from_workobject[:3, 3] = [500, -20, 300]
    path = Toolpath(Cutter(), (layer,), (), 1.5, 40.0, 1.0, 1.0, 5.0, base_from_workobject, "a\nend\n#!")
    feed = np.array([20.0, 1.0, 1.0, 1.25, 20.0, 20.0])
    return Moves(position, q, circular, via, via_q, feed, flags, np.array([0, 1, 1, 1, 0, 0]), path, 9, 0.01, 0.05)


@pytest.fixture
def passed(moves):
    return PathGate(True, "ok", toolpath=moves.toolpath, tolerance_mm=1.0)


@pytest.fixture
def postures(moves):
    """Of two points."""
    none = np.zeros(2)
    return Postures(
        moves.toolpath,
        none,
        none,
        none,
        np.zeros((2, 3)),
        np.zeros((2, 4)),
        none,
        none,
        none,
        np.zeros((2, 6)),
        np.zeros((2, 3)),
        none,
        np.eye(4),
        False,
    )
