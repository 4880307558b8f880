"""Other methods, as one would write them without this project: what stands beside it in the tables."""
