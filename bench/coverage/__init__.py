"""Whether the stated uncertainties hold, over both simulators: `python -m bench.coverage`."""

import os

for _name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # processor time is what is told, and a process measures one part at a time
