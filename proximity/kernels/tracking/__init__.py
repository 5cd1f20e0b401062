"""One tick: distances with bounds, motion and prediction of every finger."""
