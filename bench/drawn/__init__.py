"""Random parts by seed, under named conditions; nothing is chosen to be easy to measure."""
