"""Real motors: drivers of three protocols, homing, and a drum that stops at any uncertainty."""
