"""Errors and uncertainties over many simulated parts, beside other methods: `python -m bench.metrology`."""
