"""Plug-ins that come with the project: they enter by `pyproject.toml` as a stranger's, import `workbench.api` only."""
