"""Predicted against achieved uncertainty of planned scans, on two simulators that share no code."""
