"""Mutated files for every reader: only a result or one clear line may come of them."""
