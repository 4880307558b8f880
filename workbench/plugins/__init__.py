"""Plug-ins that come with the project: registered in `pyproject.toml` as anyone's are, by `workbench.api` alone."""
