"""The closed loop on simulated raw edges: scan, plan, mill, scan, inspect."""
