"""Sphinx's settings: Markdown by MyST, the theme that Sphinx brings along, nothing from a network."""

import re

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

from workbench import __version__

project = "workbench"
version = release = __version__
copyright = "the workbench authors, MIT licence"

extensions = ["myst_parser"]
root_doc = "README"
source_suffix = {".md": "markdown"}
exclude_patterns = ["docs/examples/*/.pytest_cache"]
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
myst_dmath_allow_labels = False
myst_dmath_allow_digits = False
html_math_renderer = "mathml"  # which browsers draw by themselves; MathJax would come from a network
highlight_language = "text"
suppress_warnings = ["misc.highlighting_failure"]  # JSON with `...` or ${inputs}

html_theme = "alabaster"
html_title = "workbench"
html_sidebars = {"**": ["about.html", "searchfield.html", "navigation.html"]}
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "description": "Point-cloud workbench for robotic bevel milling",
    "fixed_sidebar": True,
    "page_width": "1280px",
    "sidebar_width": "240px",
    "font_family": "system-ui, sans-serif",
    "head_font_family": "system-ui, sans-serif",
    "show_powered_by": False,
    "show_relbars": False,
}


def _math(writer, node):
    """Write an equation as MathML; its \\tag beside it."""
    latex, *tag = re.split(r"\\tag\{(.+?)\}", node.astext())
    block = node.tagname == "math_block"
    writer.body.append(convert(latex.strip(), display="block" if block else "inline"))
    if block:
        number = f'<div class="tag">({tag[0]})</div>' if tag else ""
        writer.body[-1] = f'<div class="equation">{writer.body[-1]}{number}</div>'
    raise SkipNode


def setup(app):
    """Sphinx's hook."""
    app.add_html_math_renderer("mathml", inline_renderers=(_math, None), block_renderers=(_math, None))
