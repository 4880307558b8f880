"""How fast, beside what else one would use: both sides in one run, in turn. `make bench`."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `workbench` has it: its threads wait busily
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # users keep the byte code of the sources
