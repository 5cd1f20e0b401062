"""A scan against its part, and parts in the frame of a map."""

import re

import mesh_files
import numpy as np
import pytest
import shapes

LOWER = [260_978_300.857938, 7_007_098_221.195780, 0.0]  # mm
VERTICES, FACES = shapes.box(LOWER, np.add(LOWER, [20.0, 10.0, 5.0]))


@pytest.fixture
def map_part(tmp_path):
    """A part of 20 mm, far from the origin."""
    path = tmp_path / "part.obj"
    path.write_bytes(mesh_files.obj(VERTICES, FACES))
    return path


def test_coordinates_of_a_map_are_printed_with_the_digits_that_their_size_needs(run, map_part):
    # Was: from and to were both 2.60978e+08.
    out = run("check", map_part).out
    corners = [
        re.search(rf"^{label} +(\S+)  (\S+)  (\S+) mm$", out, re.MULTILINE) for label in ("from", "to")
    ]
    sizes = np.diff([[float(word) for word in corner.groups()] for corner in corners], axis=0)[0]
    assert np.allclose(sizes, [20, 10, 5], atol=1e-4)


def test_answers_in_the_frame_of_a_map_keep_thousandths(run, map_part):
    x, y, _ = np.add(LOWER, [10, 20, 0]).tolist()
    lines = run("query", map_part, f"{x:.6f}", f"{y:.6f}", 3).out
    assert f"{x:.4f}" in lines and f"{LOWER[1] + 10:.4f}" in lines
    table = run("query", map_part, f"{x:.6f}", f"{y:.6f}", 3, f"{x + 0.5:.6f}", f"{y:.6f}", 3).out
    assert f"{x:.4f}" in table and f"{x + 0.5:.4f}" in table
