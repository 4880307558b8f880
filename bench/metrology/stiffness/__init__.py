"""Joint stiffness from simulated loading tests, against the truth and the Cramer-Rao bound."""
