"""How fast, beside what else one would use: both sides in one run, in turn. `make bench`."""
