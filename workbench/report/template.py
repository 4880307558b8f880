"""The report's HTML: jinja2 templates with autoescape.

Names out of files (part, paths, causes) are data: they reach the page as text only.
"""

from __future__ import annotations

import base64
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from workbench.report.colours import SIGNS
from workbench.report.values import COVERAGE


def environment(package: str) -> Environment:
    """The templates of a package of this project."""
    return Environment(
        loader=PackageLoader(package, ""),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


_ENVIRONMENT = environment("workbench.report")


def render(name: str, **values: Any) -> str:
    """The template `name` filled in; every value is escaped unless it is Markup."""
    return _ENVIRONMENT.get_template(name).render(signs=SIGNS, coverage=f"{COVERAGE:g}", **values)


def source(name: str) -> Markup:
    """A file of the report as it is, such as its style sheet."""
    loader = _ENVIRONMENT.loader
    assert loader is not None
    return Markup(loader.get_source(_ENVIRONMENT, name)[0])


def data_address(picture: bytes) -> str:
    """A PNG or SVG picture as an address that holds it."""
    sort = "image/png" if picture.startswith(b"\x89PNG") else "image/svg+xml"
    return f"data:{sort};base64,{base64.b64encode(picture).decode()}"
