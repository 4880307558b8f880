"""What docs/calibration.md says of the paper's section 3: each statement is a command here."""
