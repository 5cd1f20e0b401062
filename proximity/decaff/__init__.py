"""The DECAFF glove and its paper: models, limits, device, controller.

SI units and radians throughout. Compression into a wall is positive, and so is the force on the finger,
directed out of the wall; a contact never pulls. Values that the paper does not give are marked (A),
assumed. (7) and FIG 5 are the paper's own numbers. "PAPER 6.4" is a section of the page of notes on it that
this is made from; the page is not part of the project, and what is taken from it is said where it is used.
"""
