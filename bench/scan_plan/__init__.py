"""Planned scans: what was promised of them and what came of it, on two simulators that share no code."""
