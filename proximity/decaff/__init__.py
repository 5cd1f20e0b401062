"""The device of the DECAFF paper: glove, drum, and the controller of the drum.

SI units and radians throughout. Compression into a wall is positive, and so is the force on the finger,
directed out of the wall; a contact never pulls. Values that the paper does not give are marked (A), assumed.
(7) and FIG 5 are the paper's own numbers. `docs/science/drum.md` lists the assumptions and their
consequences.
"""

from proximity.system.extras import needed

with needed("services, gloves, drums and studies need", "service"):
    import scipy  # noqa: F401
