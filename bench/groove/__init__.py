"""How far measured grooves lie off, in millimetres, degrees and standard uncertainties, over random parts."""
