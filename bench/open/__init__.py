"""The open benchmark of edges: recordings by tracks, sealed truth, rivals behind one interface (docs/benchmark.md)."""

from bench.harness import single_threaded

single_threaded()
