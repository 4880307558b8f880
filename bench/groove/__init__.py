"""How far sizes of grooves and of prepared plates lie off, in mm, deg and standard uncertainties."""
