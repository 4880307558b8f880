"""How values and the report's HTML are written.

A value has its expanded uncertainty, and digits after it (GUM 7.2.2, 7.2.6). Templates are jinja2's with autoescape:
names out of files (part, paths, causes) are data, which reach the page as text only.
"""

from __future__ import annotations

import base64
import functools
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.marks import SIGNS
from workbench.templates import environment
from workbench.units import COVERAGE, Float

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def decimals(uncertainties: Iterable[float | None], coverage: float = COVERAGE, most: int = 4) -> int:
    """Decimal places, one to `most`, for the smallest expanded uncertainty: two digits of it, which no rounding makes
    smaller by more than 5 % (EA-4/02 M, 6.3).
    """
    known = [coverage * u for u in uncertainties if u is not None and u > 0.0 and math.isfinite(u)]
    if not known:
        return 3
    return min(most, max(1, 1 - math.floor(math.log10(min(known)))))


def measured(value: float | None, u: float | None, places: int) -> str:
    """'1.503 ± 0.012'; a dash where nothing was measured."""
    if value is None or not math.isfinite(value):
        return "–"
    if u is None or not math.isfinite(u):
        return plain(value, places)
    return f"{plain(value, places)} ± {COVERAGE * u:.{places}f}"


def span(values: Float, places: int, unit: str) -> str:
    """'1.421 to 1.583 mm' over what was measured, '1.42 mm' where both ends are written alike."""
    known = values[np.isfinite(values)]
    ends = dict.fromkeys(plain(float(end), places) for end in (known.min(), known.max())) if len(known) else ("–",)
    return " to ".join(ends) + (unit if len(known) else "")


def plain(value: float, places: int) -> str:
    """'−0.012', and '0.000' for what rounds to nothing, whatever its sign."""
    text = f"{value:.{places}f}"
    return text.replace("-", "" if float(text) == 0.0 else "−")


def signed(value: float, places: int) -> str:
    """A deviation: '+0.012', '−0.012', and '0.000' for what rounds to nothing."""
    text = plain(value, places)
    return f"+{text}" if float(text.replace("−", "-")) > 0.0 else text


def alike(*values: float) -> tuple[str, ...]:
    """Set values, such as limits, with as many decimals as the one that needs most: '1.0', '1.5', '2.0'."""
    places = max(len(f"{value:.9g}".partition(".")[2]) for value in values)
    return tuple(f"{value:.{places}f}" for value in values)


@functools.cache
def _templates() -> Environment:
    return environment("workbench.report")


def render(name: str, **values: Any) -> str:
    """The template `name` filled in; every value is escaped unless it is Markup."""
    return _templates().get_template(name).render(signs=SIGNS, coverage=f"{COVERAGE:g}", **values)


def source(name: str) -> Markup:
    """A file of the report as it is, such as its style sheet."""
    from markupsafe import Markup

    loader = _templates().loader
    assert loader is not None
    return Markup(loader.get_source(_templates(), name)[0])


def data_address(picture: bytes) -> str:
    """A PNG or SVG picture as an address that holds it."""
    sort = "image/png" if picture.startswith(b"\x89PNG") else "image/svg+xml"
    return f"data:{sort};base64,{base64.b64encode(picture).decode()}"
