"""Stages that write programs for robot controllers: `program.*`."""
