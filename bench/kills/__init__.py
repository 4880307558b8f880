"""Runs killed at random moments: the output directory holds a whole old set of results, a whole new one, or none."""
