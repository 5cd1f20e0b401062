"""Real motors, with drivers for their protocols, homing, and a drum that stops at any uncertainty."""
