"""Calibrations by formula: the paper's way to the hand-eye pose, a robot's own errors, a fixed part with flat faces."""
