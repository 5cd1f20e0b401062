"""3MF files: every placement is there, and no small file takes long or much memory."""

import zipfile

import mesh_files
import numpy as np
import pytest

import proximity
from proximity import formats
from proximity.errors import MeshFormatError

SHIFT = "1 0 0 0 1 0 0 0 1 {} {} 0"
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]


def with_objects(model, text):
    return model.replace("</resources>", text + "</resources>")


def components(own_id, *targets):
    """An object of components, one behind the other along y."""
    rows = "".join(
        f'<component objectid="{target}" transform="{SHIFT.format(0, 10 * k)}"/>'
        for k, target in enumerate(targets)
    )
    return f'<object id="{own_id}"><components>{rows}</components></object>'


def write(folder, model):
    path = folder / "part.3mf"
    path.write_bytes(mesh_files.threemf(model))
    return path


@pytest.mark.parametrize(("component_count", "item_count"), [(3, 12), (40, 40)])
def test_every_component_of_every_item_is_placed(tmp_path, component_count, item_count):
    items = [(99, SHIFT.format(1000 * k, 0)) for k in range(item_count)]
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, items)
    path = write(tmp_path, with_objects(model, components(99, *[1] * component_count)))

    geometries = formats.read_geometries(path).geometries

    positions = {tuple(np.round(geometry.pose.translation * 1000)) for geometry in geometries}
    assert positions == {(1000 * k, 10 * j, 0) for k in range(item_count) for j in range(component_count)}
    assert len({geometry.name for geometry in geometries}) == component_count * item_count
    assert len({id(geometry.vertices) for geometry in geometries}) == 1


def test_pairs_of_pairs_are_all_placed(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(9, SHIFT.format(0, 0))])
    nested = "".join(components(k, k - 1, k - 1) for k in range(2, 10))
    scene = proximity.load(write(tmp_path, with_objects(model, nested)))
    assert len(scene.parts) == 256


def test_more_placements_than_anybody_means_are_refused_with_their_number(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(61, SHIFT.format(0, 0))])
    nested = "".join(components(k, k - 1, k - 1) for k in range(2, 62))
    with pytest.raises(MeshFormatError, match=f"it places {2**60} parts, expected at most 20000"):
        formats.read_geometries(write(tmp_path, with_objects(model, nested)))


def test_chain_of_components_is_followed_to_its_end(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(8001, SHIFT.format(0, 0))])
    chain = "".join(components(k, k - 1) for k in range(2, 8002))
    assert len(formats.read_geometries(write(tmp_path, with_objects(model, chain))).geometries) == 1


def test_comments_that_never_end_are_refused_at_once(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(1, SHIFT.format(0, 0))])
    with pytest.raises(MeshFormatError, match="is not XML"):
        formats.read_geometries(write(tmp_path, with_objects(model, "<!--" * 400_000)))


def test_document_type_is_refused(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(1, SHIFT.format(0, 0))])
    bomb = '<!DOCTYPE model [<!ENTITY a "aaaa">]><model'
    with pytest.raises(MeshFormatError, match=r"has a document type \(<!DOCTYPE>\), expected none"):
        formats.read_geometries(write(tmp_path, model.replace("<model", bomb, 1)))


def test_archive_that_unpacks_to_too_much_is_refused_with_both_sizes(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(1, SHIFT.format(0, 0))])
    path = write(tmp_path, model + " " * 1_000_000)
    size = path.stat().st_size
    with pytest.raises(
        MeshFormatError,
        match=rf"models of {size:,} bytes unpack to 1,000,\d+ bytes, expected at most 100,000",
    ):
        proximity.load(path, unpacked_limit=100_000)
    assert len(proximity.load(path).parts) == 1


def test_archive_that_unpacks_to_hundreds_of_times_its_size_is_refused(tmp_path):
    path = tmp_path / "part.3mf"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w") as stream,
    ):
        for _ in range(60):
            stream.write(b" " * 1_000_000)
    with pytest.raises(
        MeshFormatError, match="unpack to 60,000,000 bytes, expected at most 200 times as many"
    ):
        formats.read_geometries(path)


@pytest.mark.parametrize("limit", [0, float("nan"), "2 GB"])
def test_limit_that_is_no_number_of_bytes_is_refused(tmp_path, limit):
    with pytest.raises(
        proximity.ArgumentError, match=r"unpacked_limit is .*, expected a positive number of bytes"
    ):
        formats.read_geometries(tmp_path / "part.3mf", unpacked_limit=limit)
