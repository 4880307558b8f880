"""What templates of a broken end say of single returns."""

import numpy as np
import pytest

from workbench.edge.broken_end import INCIDENCES, Depths, EndView, end_phases, free_depths, rendered_end


@pytest.mark.parametrize("lean", [0.0, 1e-4, 0.02])
def test_no_return_lies_deeper_than_the_rounding_that_it_is_on(lean: float) -> None:
    """A pixel that met the end but for the last digit saw the lower surface, though none is in view: 4 mm, or 0 / 0."""
    edges = 0.013 * np.arange(11.0)
    known = Depths(np.zeros(10), np.eye(10), free_depths(edges))
    view = EndView(known, edges, lean, 0.013, end_phases(False), 0.0, 0.0)
    size, limit, pixel, phase = (
        a.ravel()
        for a in np.meshgrid(
            [0.0, 0.005, 0.02], INCIDENCES, range(len(view.pixels[0])), range(len(view.phases)), indexing="ij"
        )
    )
    of = size, np.zeros(size.size), limit, pixel.astype(int), phase.astype(int), np.zeros(size.size)
    assert (rendered_end(view, *of)[1] <= size[:, None] + 1e-12).all()
