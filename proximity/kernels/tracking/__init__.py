"""One tick: distance with bounds, motion and prediction of each finger."""
