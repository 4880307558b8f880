"""The documentation's site: `python -m scripts.site` (`make docs`)."""
