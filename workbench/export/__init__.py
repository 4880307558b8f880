"""Clouds, sections and measurements as files that other programs read."""
