"""The measured loop on simulated raw edges: mill, scan, correct the finishing pass, mill, inspect; blind beside it."""
