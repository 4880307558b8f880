"""Scans beside scans, meshes and plans; measurements beside measurements."""
