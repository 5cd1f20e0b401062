"""The arrays that a tick reads and writes."""

import numpy as np

from proximity.kernels.contact_record import unknown_contact
from proximity.kernels.point.coherent_search import FRONTIER_SIZE
from proximity.kernels.tracking.conservative_advancement import BALLS_SIZE
from proximity.kernels.tracking.finger_distance import CROWD
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES
from proximity.kernels.tracking.part_drift import POSE_COLUMNS, movers_workspace
from proximity.kernels.tracking.track import TRACK
from proximity.kernels.traverse.best_first import WORKSPACE_SIZE


def arrays_for(count: int, settings: np.ndarray) -> dict[str, np.ndarray]:
    """Return what a tick reads and writes beside its records, by the names in `kernels.tracking.track`."""
    return {
        "settings": settings,
        "pose_ns": np.zeros(count, np.int64),
        "velocities": np.full((count, 3), np.nan),
        "paths": np.full((count, 2, 3), np.nan),
        "path_bends": np.array([0.0, 1.0]),
        "bends": np.full(count, np.nan),
        "path_lengths": np.zeros(2),
        "motions": np.zeros((count, ESTIMATES), ESTIMATE),
        "tracks": np.zeros(count, TRACK),
        "balls": np.zeros((count, BALLS_SIZE)),
        "frontiers": np.zeros((count if count <= CROWD else 0, FRONTIER_SIZE), np.float32),
        "unknown": unknown_contact(),
        "before": np.zeros((0, POSE_COLUMNS)),
        "movers": movers_workspace(0),
        "workspace": np.zeros(WORKSPACE_SIZE, np.float32),
    }
