"""Studies: a job that is done for every condition of a design, on all cores of one machine or many.

    study file → conditions → batches on Ray → rows in Parquet → page

`jobs` describes what a study may vary and what it measures. Jobs know neither Ray nor Parquet.
"""
