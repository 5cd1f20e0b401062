"""Where a recorded hand goes in a scene, and motions for timing ticks."""

from proximity.tracker.replay.placement import fitted_pose, turn_about_axes

__all__ = ["fitted_pose", "turn_about_axes"]
