"""What several benchmarks share: the machine, threads, clocks, verdicts, and the folders of the project."""
