"""Does an error in the sources fail a test."""
