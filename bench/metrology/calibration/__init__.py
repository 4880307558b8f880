"""Hand-eye calibration on simulated spheres, against the true pose and the Cramer-Rao bound."""
