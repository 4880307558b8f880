"""Sphinx's settings: Markdown by MyST, the theme that Sphinx brings along, nothing from a network."""

from importlib.metadata import version as installed

project = "workbench"
version = release = installed("workbench")
copyright = "the workbench authors, MIT licence"

extensions = ["myst_parser"]
root_doc = "README"
source_suffix = {".md": "markdown"}
exclude_patterns = ["docs/examples/*/.pytest_cache"]
myst_heading_anchors = 4
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
