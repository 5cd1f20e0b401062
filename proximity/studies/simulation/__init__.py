"""Hand, finger, wall and drum in closed loop."""
