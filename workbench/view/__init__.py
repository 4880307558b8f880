"""The report with its 3-D, served to a browser on this machine."""
