"""Shared parts of benchmarks: the machine, threads, clocks, verdicts, and the folders of the project."""
