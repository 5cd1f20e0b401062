"""The page of a study: effects of its factors, plots, worst conditions."""
