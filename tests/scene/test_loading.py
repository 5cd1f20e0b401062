"""Files to scenes: what stands in many places is made once, and is asked as if it had been made each time."""

import mesh_files
import numpy as np
import pytest
import shapes
from project import MESHES

import proximity
from proximity import Part, Scene
from proximity.scene import sign


def pair_in_three_places(tmp_path):
    """Two boxes that are one mesh, at two places and, mirrored, at a third."""
    pair = shapes.join(shapes.cube(0.1), shapes.moved(shapes.cube(0.1), (0.3, 0.0, 0.0)))
    nodes = [
        {"mesh": 0, "name": "left"},
        {"mesh": 0, "name": "right", "translation": [1.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.6, 0.8]},
        {"mesh": 0, "name": "other", "translation": [0.0, 1.0, 0.0], "scale": [-1.0, 1.0, 1.0]},
    ]
    path = tmp_path / "pair.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[pair]], nodes)))
    return proximity.load(path)


def test_instances_of_one_mesh_share_their_solids(tmp_path):
    scene = pair_in_three_places(tmp_path)

    assert [part.name for part in scene.parts] == [
        "left.1", "left.2", "right.1", "right.2", "other.1", "other.2",
    ]  # fmt: skip
    solids = [part.solid for part in scene.parts]
    assert solids[0] is solids[2] and solids[1] is solids[3]
    assert solids[4] is not solids[0]  # the mirrored one has other vertices


def test_instances_answer_as_parts_that_were_made_for_themselves(tmp_path):
    scene = pair_in_three_places(tmp_path)
    apart = [
        Part(
            part.name,
            proximity.Solid(part.solid.mesh.vertices, part.solid.mesh.faces),
            part.pose,
            part.source_faces,
        )
        for part in scene.parts
    ]
    points = np.random.default_rng(3).uniform(-0.5, 1.5, (2000, 3))

    found, expected = scene.closest(points), Scene(apart).closest(points)

    for field in ("signed_distance", "point", "gradient", "part"):  # of faces that tie another may be named
        assert np.allclose(getattr(found, field), getattr(expected, field), rtol=0.0, atol=1e-14)


def test_memory_of_a_shared_solid_is_counted_once(tmp_path):
    scene = pair_in_three_places(tmp_path)
    solids = {part.solid for part in scene.parts}
    meshes = sum(solid.mesh.vertices.nbytes + solid.mesh.faces.nbytes for solid in solids)
    assert len(solids) == 4
    assert scene.memory_bytes - scene.snapshot().memory_bytes == meshes


def test_file_that_places_a_part_too_far_off_is_refused(tmp_path):
    nodes = [{"mesh": 0, "name": "lid", "translation": [1e200, 0.0, 0.0]}]
    path = tmp_path / "far.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[shapes.cube()]], nodes)))

    with pytest.raises(proximity.MeshError) as refusal:
        proximity.load(path)

    assert str(refusal.value).startswith(
        f"{path}: part 'lid' would be moved by 1e+200 m, which is farther than"
    )


def test_progress_of_loading_counts_meshes():
    counted = []

    proximity.load(MESHES / "assembly.step", progress=lambda done, total: counted.append((done, total)))

    total = len(counted)
    assert total > 1 and counted == [(done, total) for done in range(1, total + 1)]


def test_many_small_parts_are_each_assembled_once(tmp_path, monkeypatch):
    """Each cube of a file was put together twice, and drew the same samples anew."""
    made = []
    whole = sign.assemble
    monkeypatch.setattr(sign, "assemble", lambda *given: made.append(len(given[0])) or whole(*given))
    sign._random_samples.cache_clear()
    cubes = [shapes.moved(shapes.cube(0.1 + 0.001 * k), (0.3 * k, 0.0, 0.0)) for k in range(20)]
    path = tmp_path / "cubes.glb"
    nodes = [{"mesh": row} for row in range(20)]
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[cube] for cube in cubes], nodes)))
    scene = proximity.load(path)

    assert made == [1] * 20
    assert sign._random_samples.cache_info().misses == 1
    for part in scene.parts:
        assert scene.signed_distance(part.pose.point(np.mean(part.solid.bounds, axis=0))) < 0.0
