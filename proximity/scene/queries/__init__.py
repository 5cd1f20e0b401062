"""The queries that solids and scenes answer: arguments, batches and records."""
