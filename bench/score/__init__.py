"""One score for a value and its uncertainty, over simulated parts that share no code: `python -m bench.score`."""

import os

for _name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # a process measures one part at a time
