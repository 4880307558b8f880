"""Results of any program against the truth: `workbench score`. The formula and its code: `scorer`, by numpy alone."""
