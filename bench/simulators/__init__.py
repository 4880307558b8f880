"""Simulators beside the package's, which judge: of its code they share at most the form of recipes and truths."""
