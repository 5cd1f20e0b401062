"""Latency certificate of a scene: the cost of ticks at its worst positions, compared with a sample period.

    file → subject → worst positions → measurement (ticks, loop) → verdict → report (text, JSON, picture)

The search climbs on work, which is the same on every run; only the measurement at the end is time.
"""
