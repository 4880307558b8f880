"""One score for a value and its uncertainty, over simulated parts that share no code: `python -m bench.score`."""

from bench.harness import single_threaded

single_threaded()
