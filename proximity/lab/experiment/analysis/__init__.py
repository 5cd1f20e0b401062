"""Analysis of an experiment: psychometric functions, scores, their comparison, power, and the report."""
