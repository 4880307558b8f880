"""Stages that plan the milling path: `path.*`."""
