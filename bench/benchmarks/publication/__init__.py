"""The figures of the README, made from the JSON of published runs."""
