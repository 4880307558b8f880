"""Plug-ins that come with the project: they enter by the stranger's door and import `workbench.api` only."""
