"""Benchmarks: Canaxis beside its peers, in one run. `python -m bench`; docs/benchmarks.md says what it means.

Each part is a module with a function `run` (see `bench.parts`) and can be run alone: `python -m bench.sdo`.
"""
