"""The open benchmark of edges: recordings by tracks, sealed truth, rivals behind one interface (docs/benchmark.md)."""

import os

for _name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # a process measures one recording at a time
