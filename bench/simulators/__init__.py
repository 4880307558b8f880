"""Simulators that judge and nothing is developed on: no code of `workbench.synthetic`, nor of one another."""
