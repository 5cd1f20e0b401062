"""Comparisons of the package's results with the oracle, common to solids and to parts of scenes."""

import numpy as np

import oracle

ROUNDING = 2.0**-52


def allowance(distance, *coordinates):
    """Allowed distance error: 1e-12 relative plus 1e-15 times the largest coordinate."""
    largest = max(float(np.abs(each).max()) for each in coordinates)
    return 1e-12 * np.abs(distance) + 1e-15 * largest


def signed_distance(vertices, faces, points):
    """Compute signed distances from the oracle's distance and winding number."""
    distance = oracle.closest(vertices, faces, points).distance
    return np.where(oracle.winding_number(vertices, faces, points) > 0.5, -distance, distance)


def assert_distance_is_right(found, vertices, faces, points):
    """Check that unsigned distances are within `allowance` of the oracle's."""
    points = np.asarray(points, dtype=np.float64)
    expected = oracle.closest(vertices, faces, points).distance
    off = np.abs(np.abs(found) - expected)
    assert (off <= allowance(expected, vertices)).all(), f"off by {off.max()} of {expected.max()}"


def assert_answer_holds_together(hit, vertices, faces, points):
    """Check that distance, point, face, barycentric and gradient of a mesh's result are consistent."""
    points = np.asarray(points, dtype=np.float64)
    distance = np.abs(hit.signed_distance)
    room = 8.0 * ROUNDING * max(float(np.abs(vertices).max()), float(np.abs(points).max()))
    weights = hit.barycentric
    corners = np.asarray(vertices)[np.asarray(faces)[hit.face_id]]
    assert (weights >= 0.0).all()
    assert np.abs(weights.sum(axis=-1) - 1.0).max() <= 4.0 * ROUNDING
    assert np.abs((weights[..., None] * corners).sum(axis=-2) - hit.point).max() <= room
    assert np.abs(np.linalg.norm(points - hit.point, axis=-1) - distance).max() <= room
    assert np.abs(np.linalg.norm(hit.gradient, axis=-1) - 1.0).max() <= 8.0 * ROUNDING
    # A step back along the gradient leads to the surface, from either side.
    back = points - np.asarray(hit.signed_distance)[..., None] * hit.gradient
    assert np.abs(back - hit.point).max() <= room


def slant(hit, directions):
    """Return 1 / cos(angle between ray and normal), which amplifies rounding into hit displacement."""
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return 1.0 / np.maximum(np.abs((unit * hit.normal).sum(axis=-1)), 1e-12)


def is_near(found, expected, room):
    """Test whether two distances differ by at most *room*, or are both infinite."""
    both_miss = np.isinf(found) & np.isinf(expected)
    finite = np.isfinite(found) & np.isfinite(expected)
    off = np.abs(np.where(finite, found, 0.0) - np.where(finite, expected, 0.0))
    return both_miss | (finite & (off <= room))


def same_bits(first, second):
    """Test whether two records or arrays are bitwise equal; nan equals nan."""
    if hasattr(first, "_fields"):
        return all(same_bits(getattr(first, name), getattr(second, name)) for name in first._fields)
    first, second = np.asarray(first), np.asarray(second)
    return first.dtype == second.dtype and first.shape == second.shape and first.tobytes() == second.tobytes()
