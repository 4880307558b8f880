"""The pictures on the pages of the stages: `python -m scripts.pictures` (`make docs`)."""
