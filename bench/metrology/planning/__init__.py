"""Milling paths planned from simulated raw edges, against the bevel that the true edge implies."""
