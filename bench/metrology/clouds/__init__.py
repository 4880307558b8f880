"""Clouds without a grid: the same parts by their grid, by their points in order, and by their points shuffled."""
