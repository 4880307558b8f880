"""Stages of the simulated cell, whose truth is known: `twin.*`."""
