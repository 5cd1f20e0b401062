"""Nodes for tests of single-node kernels."""

import numpy as np

from proximity.kernels.layout import BOX_STRIDE, LANES, NODE_STRIDE
from proximity.kernels.tree.builder import face_boxes


def node_of(contents):
    """A node of up to eight boxes around points (B, K, 3), made by the builder's functions."""
    node = np.zeros(NODE_STRIDE, np.float32)
    node[:24], node[24:48] = np.inf, -np.inf
    for lane, points in enumerate(contents):
        # A face whose corners are the extremes has the box of all points.
        corners = np.stack([points.min(axis=0), points.max(axis=0), points[0]])
        box = np.empty(BOX_STRIDE, np.float32)
        face_boxes(corners, np.array([[0, 1, 2]], np.int32), box)
        node[lane:24:LANES], node[24 + lane : 48 : LANES] = box[:3], -box[4:7]
    return node
