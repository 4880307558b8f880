"""Studies of the comparison stages: what docs/comparison.md states."""
