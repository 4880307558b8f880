"""Many parts: one run a part, and the page of the fleet."""
