"""3MF: every placement is there, holes are holes, supports are no parts, and no small file takes long."""

import zipfile

import mesh_files
import numpy as np
import pytest
import shapes
from mesh_reading import read, refusal

import proximity
from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats.threemf import volumes

EXTENSION = "http://schemas.microsoft.com/3dmanufacturing/"
CORE = EXTENSION + "core/2015/02"
SLIC3R, BAMBU = "Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config"
RELATIONSHIPS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">{}</Relationships>'
)
RELATIONSHIP = '<Relationship Id="r{0}" Type="' + EXTENSION + '2013/01/3dmodel" Target="{0}"/>'
HERE = "1 0 0 0 1 0 0 0 1 0 0 0"


def box(lower, upper):
    """A closed box, its faces outward."""
    vertices, faces = shapes.cube()
    vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0)
    return np.asarray(lower) + vertices * (np.asarray(upper, dtype=float) - lower), faces


PART = box((0, 0, 0), (20, 10, 5))
SLOT = box((4, -1, 2), (8, 11, 6))  # 4 x 10 x 3 mm of the part
PEG = box((12, 4, -1), (14, 6, 9))


def joined(*meshes):
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [np.asarray(faces) + start for (_, faces), start in zip(meshes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def model(objects, items=((1, HERE),), resources=""):
    return mesh_files.threemf_model(objects, items).replace("</resources>", resources + "</resources>")


def write(folder, text, root="3D/3dmodel.model", **others):
    """A 3MF of a root model and other files by name."""
    path = folder / "part.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {root: text, **others}.items():
            archive.writestr(name, data)
    return path


def slic3r(*kinds, key="volume_type", last=11):
    """Settings in which each 12 triangles of object 1 are a volume."""
    rows = "".join(
        f'<volume firstid="{12 * k}" lastid="{12 * k + last}">'
        f'<metadata key="name" value="v"/><metadata type="volume" key="{key}" value="{kind}"/></volume>'
        for k, kind in enumerate(kinds)
    )
    return (
        f'<config><object id="1" instances_count="1"><metadata key="name" value="x"/>{rows}</object></config>'
    )


def bambu(**subtypes):
    rows = "".join(f'<part id="{own[1:]}" subtype="{kind}"/>' for own, kind in subtypes.items())
    return f'<config><object id="9"><metadata key="name" value="x"/>{rows}</object></config>'


def assembly(*components):
    rows = "".join(f'<component objectid="{k}" transform="{matrix}"/>' for k, matrix in components)
    return f'<object id="9"><components>{rows}</components></object>'


def volumes_of(path):
    """Volume of each part, mm³."""
    return [part.diagnosis.volume * 1e9 for part in (p.solid for p in proximity.load(path).parts)]


def notes_of(path):
    return formats.read_geometries(path).notes


# Placements

SHIFT = "1 0 0 0 1 0 0 0 1 {} {} 0"
SMALL = box((0, 0, 0), (1, 1, 1))
COMPONENT_IN_FILE = '<component p:path="/3D/part{}.model" objectid="{}"/>'


def components(own_id, *targets):
    """An object of components, one behind the other along y."""
    return assembly(*((target, SHIFT.format(0, 10 * k)) for k, target in enumerate(targets))).replace(
        'id="9"', f'id="{own_id}"', 1
    )


def nested(target, *objects):
    return model({1: SMALL}, [(target, HERE)], "".join(objects))


@pytest.mark.parametrize(
    ("unit", "name", "metres"),
    [
        ("", "mm", 0.001),
        (' unit="inch"', "in", 0.0254),
        (' unit="micron"', "um", 1e-6),
        (' unit="meter"', "m", 1.0),
    ],
)
def test_3mf_declares_its_unit_and_places_its_objects(tmp_path, unit, name, metres):
    vertices, faces = shapes.cube()[0] + 0.1, shapes.cube()[1]
    items = [(1, HERE), (1, "0 1 0 -1 0 0 0 0 1 5 6 7"), (2, "2 0 0 0 2 0 0 0 2 0 0 0")]
    text = mesh_files.threemf_model(dict.fromkeys((1, 2, 3), (vertices, faces)), items, unit)
    contents = read(tmp_path, "part.3mf", mesh_files.threemf(text), units="km")
    assert (contents.format, contents.units, contents.units_declared) == ("3MF", name, True)
    named = {geometry.name: geometry for geometry in contents.geometries}
    assert sorted(named) == ["part1", "part1_2", "part2"]
    first, turned, doubled = (named[name] for name in sorted(named))
    assert np.array_equal(first.vertices, vertices * metres)
    assert np.allclose(turned.pose.translation, np.array([5, 6, 7]) * metres, rtol=1e-15)
    assert np.allclose(turned.pose.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert np.array_equal(doubled.vertices, vertices * (2 * metres))
    assert "1 of its objects are not part of the build and were ignored" in contents.notes


@pytest.mark.parametrize(("component_count", "item_count"), [(3, 12), (40, 40)])
def test_every_component_of_every_item_is_placed(tmp_path, component_count, item_count):
    items = [(99, SHIFT.format(1000 * k, 0)) for k in range(item_count)]
    text = model({1: SMALL}, items, components(99, *[1] * component_count))
    geometries = formats.read_geometries(write(tmp_path, text)).geometries
    positions = {tuple(np.round(geometry.pose.translation * 1000)) for geometry in geometries}
    assert positions == {(1000 * k, 10 * j, 0) for k in range(item_count) for j in range(component_count)}
    assert len({geometry.name for geometry in geometries}) == component_count * item_count
    assert len({id(geometry.vertices) for geometry in geometries}) == 1


def test_pairs_of_pairs_are_placed_or_refused_with_their_number_and_chains_followed(tmp_path):
    pairs = [components(k, k - 1, k - 1) for k in range(2, 62)]
    assert len(proximity.load(write(tmp_path, nested(9, *pairs[:8]))).parts) == 256
    words = f"it places {2**60} parts, expected at most 20000"
    assert refusal(write(tmp_path, nested(61, *pairs))) == words
    chain = (components(k, k - 1) for k in range(2, 8002))
    assert len(formats.read_geometries(write(tmp_path, nested(8001, *chain))).geometries) == 1


def test_archive_that_unpacks_to_too_much_is_refused_with_both_sizes(tmp_path):
    path = write(tmp_path, model({1: SMALL}) + " " * 1_000_000)
    size = path.stat().st_size
    words = rf"models of {size:,} bytes unpack to 1,00\d,\d+ bytes, expected at most 100,000"
    with pytest.raises(MeshFormatError, match=words):
        proximity.load(path, unpacked_limit=100_000)
    assert len(proximity.load(path).parts) == 1
    assert "expected at most 200 times as many" in refusal(write(tmp_path, " " * 60_000_000))


@pytest.mark.parametrize("limit", [0, float("nan"), "2 GB"])
def test_limit_that_is_no_number_of_bytes_is_refused(tmp_path, limit):
    with pytest.raises(
        proximity.ArgumentError, match=r"unpacked_limit is .*, expected a positive number of bytes"
    ):
        formats.read_geometries(tmp_path / "part.3mf", unpacked_limit=limit)


@pytest.mark.parametrize("ids", [(1, 2), (1, 1)])  # they count per model file
def test_3mf_of_several_model_files_is_read_with_what_they_do_not_place(tmp_path, ids):
    extra = {own: "<object id='7'><mesh/></object>" + components(8, own) for own in ids}
    others = {f"3D/part{k}.model": model({own: SMALL}, [], extra[own]) for k, own in enumerate(ids)}
    parts = "".join(COMPONENT_IN_FILE.format(k, own) for k, own in enumerate(ids))
    text = model({}, [(9, HERE)], f'<object id="9"><components>{parts}</components></object>')
    path = write(tmp_path, text.replace("<model ", '<model xmlns:p="p" ', 1), **others)
    contents = formats.read_geometries(path)
    assert [len(geometry.faces) for geometry in contents.geometries] == [12, 12]
    assert contents.notes[0] == "2 of its objects are not part of the build and were ignored"


def test_3mf_behind_a_large_picture_is_recognised(tmp_path):
    path = tmp_path / "part.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("Metadata/thumbnail.png", bytes(100_000))
        archive.writestr("3D/3dmodel.model", model({1: SMALL}))
    assert len(formats.read_geometries(path).geometries) == 1


def test_known_extension_may_have_another_prefix(tmp_path):
    text = model({1: SMALL}).replace(
        "<model ", f'<model xmlns:q="{EXTENSION}production/2015/06" requiredextensions="q" '
    )
    assert len(formats.read_geometries(write(tmp_path, text)).geometries) == 1


# Volumes of slicers


def test_negative_volume_of_prusaslicer_is_a_hole(tmp_path):
    settings = slic3r("ModelPart", "NegativeVolume")
    path = write(tmp_path, model({1: joined(PART, SLOT)}), **{SLIC3R: settings})
    scene = proximity.load(path)
    assert scene.signed_distance([0.006, 0.005, 0.004]) == pytest.approx(0.002, abs=1e-12)
    assert volumes_of(path) == pytest.approx([1000 - 120])
    assert notes_of(path) == ("negative volumes were subtracted from 1 of its parts",)


def test_faces_of_a_hole_lead_to_the_triangles_of_the_file(tmp_path):
    settings = slic3r("ModelPart", "NegativeVolume")
    path = write(tmp_path, model({1: joined(PART, SLOT)}), **{SLIC3R: settings})
    geometry = formats.read_geometries(path).geometries[0]
    vertices, faces = joined(PART, SLOT)
    corners = geometry.vertices[geometry.faces] * 1e3
    given = vertices[faces][geometry.source_faces]
    normals = np.cross(given[:, 1] - given[:, 0], given[:, 2] - given[:, 0])
    offsets = np.einsum("fkj,fj->fk", corners - given[:, :1], normals)
    assert np.abs(offsets).max() < 1e-9
    assert set(geometry.source_faces.tolist()) > set(range(4))


def test_negative_part_of_bambu_studio_is_a_hole_at_every_copy(tmp_path):
    turned = "0 1 0 -1 0 0 0 0 1 {} 0 0"
    items = [(9, turned.format(100)), (9, HERE)]
    slot = box((0, -1, 0), (4, 11, 4))
    resources = assembly((1, HERE), (2, "1 0 0 0 1 0 0 0 1 4 0 2"))
    text = model({1: PART, 2: slot}, items, resources).replace(
        'id="2" name="part2" type="model"', 'id="2" type="other"'
    )
    path = write(tmp_path, text, **{BAMBU: bambu(_1="normal_part", _2="negative_part")})
    assert volumes_of(path) == pytest.approx([880, 880])
    points = np.array([[0.1 - 0.005, 0.006, 0.004], [0.006, 0.005, 0.004], [0.1 - 0.005, 0.015, 0.004]])
    signs = np.sign(proximity.load(path).signed_distance(points))
    assert signs.tolist() == [1, 1, -1]


TURN = "0.6 0.8 0 -0.8 0.6 0 0 0 1 {} {} {}"


@pytest.mark.parametrize("is_component", [False, True], ids=["in one mesh", "as components"])
def test_hole_flush_with_the_surface_leaves_no_skin(tmp_path, is_component):
    place = TURN.format(3, 1, 4)
    if is_component:
        hole = box((0, 0, 0), (4, 10, 3))
        parts = assembly((1, TURN.format(1, 2, 3)), (2, TURN.format(1 + 0.6 * 4, 2 + 0.8 * 4, 5)))
        settings = {BAMBU: bambu(_1="normal_part", _2="negative_part")}
        path = write(tmp_path, model({1: PART, 2: hole}, [(9, place)], parts), **settings)
    else:
        settings = {SLIC3R: slic3r("ModelPart", "NegativeVolume")}
        hole = box((4, 0, 2), (8, 10, 5))
        path = write(tmp_path, model({1: joined(PART, hole)}, [(1, place)]), **settings)
    assert volumes_of(path) == pytest.approx([880])
    (part,) = proximity.load(path).parts
    assert part.solid.signed_distance([0.006, 0.005, 0.005]) == pytest.approx(0.002, abs=1e-12)
    assert part.solid.signed_distance([0.006, 0.000, 0.004]) == pytest.approx(0.002, abs=1e-12)


def test_mirrored_negative_part_is_a_hole(tmp_path):
    mirrored = "-1 0 0 0 1 0 0 0 1 12 0 0"
    resources = assembly((1, HERE), (2, mirrored))
    path = write(
        tmp_path,
        model({1: PART, 2: SLOT}, [(9, HERE)], resources),
        **{BAMBU: bambu(_1="normal_part", _2="negative_part")},
    )
    assert volumes_of(path) == pytest.approx([880])


@pytest.mark.parametrize(
    ("kind", "shown"),
    [
        ("ParameterModifier", "modifier"),
        ("SupportBlocker", "support blocker"),
        ("SupportEnforcer", "support enforcer"),
    ],
)
def test_volumes_that_steer_a_slicer_are_no_parts(tmp_path, kind, shown):
    path = write(tmp_path, model({1: joined(PART, PEG)}), **{SLIC3R: slic3r("ModelPart", kind)})
    assert volumes_of(path) == pytest.approx([1000])
    assert notes_of(path) == (f"volumes that are no parts of the shape were left out: {shown} (1)",)


def test_modifier_of_old_settings_is_no_part(tmp_path):
    path = write(tmp_path, model({1: joined(PART, PEG)}), **{SLIC3R: slic3r("0", "1", key="modifier")})
    assert volumes_of(path) == pytest.approx([1000])


def test_volumes_of_bambu_studio_that_are_no_parts_are_left_out(tmp_path):
    resources = assembly((1, HERE), (2, HERE), (3, HERE))
    path = write(
        tmp_path,
        model({1: PART, 2: SLOT, 3: PEG}, [(9, HERE)], resources),
        **{BAMBU: bambu(_1="normal_part", _2="modifier_part", _3="support_blocker")},
    )
    assert volumes_of(path) == pytest.approx([1000])
    (note,) = notes_of(path)
    assert note.endswith("were left out: modifier (1), support blocker (1)")


def test_settings_without_other_volumes_change_nothing(tmp_path):
    plain = formats.read_geometries(write(tmp_path, model({1: joined(PART, PEG)}))).geometries[0]
    path = write(tmp_path, model({1: joined(PART, PEG)}), **{SLIC3R: slic3r("ModelPart", "ModelPart")})
    contents = formats.read_geometries(path)
    assert contents.notes == ()
    np.testing.assert_array_equal(contents.geometries[0].faces, plain.faces)


def test_negative_volume_that_is_open_is_named(tmp_path):
    vertices, faces = SLOT
    path = write(
        tmp_path,
        model({1: joined(PART, (vertices, faces[:-1]))}),
        **{SLIC3R: slic3r("ModelPart", "NegativeVolume").replace('lastid="23"', 'lastid="22"')},
    )
    assert volumes_of(path) == pytest.approx([1000])
    (note,) = notes_of(path)
    assert note.startswith("not all negative volumes could be subtracted from 1 of its parts: some are too")


def test_subtractions_that_would_take_hours_are_left_with_a_note(tmp_path, monkeypatch):
    monkeypatch.setattr(volumes, "_MOST_WORK", 1023)
    path = write(tmp_path, model({1: joined(PART, SLOT)}), **{SLIC3R: slic3r("ModelPart", "NegativeVolume")})
    assert notes_of(path)[0].startswith("not all negative volumes could be subtracted")


def test_file_of_volumes_that_are_no_parts_is_refused_with_what_it_has(tmp_path):
    path = write(tmp_path, model({1: PART}), **{SLIC3R: slic3r("SupportBlocker")})
    expected = "it has no parts: volumes that are no parts of the shape were left out: support blocker (1)"
    assert refusal(path) == expected


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (slic3r("ModelPart", last=12), "the volumes of 'part1' have more than its 12 triangles"),
        (slic3r("ModelPart").replace('"0"', '"9"', 1).replace("11", "13"), "a volume has triangles 9 to 13"),
        (slic3r("ModelPart").replace("firstid", "first"), f"line 1 of '{SLIC3R}': <volume> has no firstid"),
        (slic3r("ModelPart")[:-9], f"'{SLIC3R}' is not XML (no element found"),
        ("<!DOCTYPE a>" + slic3r("ModelPart"), f"'{SLIC3R}' has a document type"),
        (slic3r("ModelPart") + " " * 60_000_000, "its models of "),
    ],
    ids=[
        "too many triangles",
        "triangles that are not there",
        "no triangles",
        "cut off",
        "document type",
        "unpacks to much",
    ],
)
def test_settings_that_lie_are_refused(tmp_path, settings, message):
    assert refusal(write(tmp_path, model({1: PART}), **{SLIC3R: settings})).startswith(message)


# Types of objects, and items


@pytest.mark.parametrize("kind", ["support", "solidsupport", "other"])
def test_support_is_no_part(tmp_path, kind):
    text = model({1: PART, 2: PEG}, [(1, HERE), (2, HERE)]).replace(
        'name="part2" type="model"', f'name="part2" type="{kind}"'
    )
    path = write(tmp_path, text)
    assert [geometry.name for geometry in formats.read_geometries(path).geometries] == ["part1"]
    assert notes_of(path) == (f"volumes that are no parts of the shape were left out: {kind} (1)",)


def test_surface_is_read(tmp_path):
    path = write(tmp_path, model({1: PART}).replace('type="model"', 'type="surface"'))
    assert len(formats.read_geometries(path).geometries) == 1


def test_item_that_should_not_be_printed_is_read_with_a_note(tmp_path):
    text = model({1: PART, 2: PEG}, [(1, HERE), (2, HERE)])
    path = write(tmp_path, text.replace('<item objectid="2"', '<item printable="0" objectid="2"'))
    contents = formats.read_geometries(path)
    assert [geometry.name for geometry in contents.geometries] == ["part1", "part2"]
    assert contents.notes == (
        '1 of the 2 items of its build (the first: item 2) should not be printed (printable="0"); '
        "they were read all the same",
    )


# Names of parts, and the root model


def test_relationship_names_the_root_model(tmp_path):
    others = {
        "_rels/.rels": RELATIONSHIPS.format(RELATIONSHIP.format("/3D/real.model")),
        "3D/3dmodel.model": model({1: PEG}),
    }
    path = write(tmp_path, model({1: PART}), "3D/real.model", **others)
    assert volumes_of(path) == pytest.approx([1000])


@pytest.mark.parametrize(
    "root", ["part.model", "3D\\3dmodel.model", "/3d/3DMODEL.model", "3D/my%20part.model"]
)
def test_root_model_is_found_whatever_it_is_called(tmp_path, root):
    target = root.replace("\\", "/").replace("%20", " ").upper()
    relationships = RELATIONSHIPS.format(RELATIONSHIP.format(target))
    path = write(tmp_path, model({1: PART}), root, **{"_rels/.rels": relationships})
    assert volumes_of(path) == pytest.approx([1000])


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["/3D/other.model"], "['/3d/other.model']"),
        (["/a.model", "/3D/3dmodel.model"], "['/3d/3dmodel.model', "),
    ],
)
def test_relationships_that_do_not_name_one_model_are_refused(tmp_path, names, shown):
    relationships = RELATIONSHIPS.format("".join(map(RELATIONSHIP.format, names)))
    path = write(tmp_path, model({1: PART}), **{"_rels/.rels": relationships, "a.model": model({1: PEG})})
    assert refusal(path).startswith(f"its _rels/.rels names the models {shown}")


@pytest.mark.parametrize("name", ["3d/Objects/A.model", "\\3D\\objects\\a.model", "3D/objects/./a.model"])
def test_component_in_another_file_is_found_whatever_the_case_and_slashes(tmp_path, name):
    text = model(
        {},
        [(9, HERE)],
        f'<object id="9"><components><component p:path="{name}" objectid="1"/></components></object>',
    )
    text = text.replace("<model", f'<model xmlns:p="{EXTENSION}production/2015/06" requiredextensions="p"')
    path = write(tmp_path, text, **{"3D/objects/a.MODEL": model({1: PART}, [])})
    assert volumes_of(path) == pytest.approx([1000])


def test_models_that_nothing_refers_to_are_not_read(tmp_path):
    path = write(tmp_path, model({1: PART}), **{"3D/old.model": "not XML"})
    assert volumes_of(path) == pytest.approx([1000])


# Namespaces and extensions


@pytest.mark.parametrize("uri", [EXTENSION + "2013/01", EXTENSION + "core/2013/12", CORE])
def test_drafts_of_the_core_are_read(tmp_path, uri):
    assert volumes_of(write(tmp_path, model({1: PART}).replace(CORE, uri))) == pytest.approx([1000])


def test_core_behind_a_prefix_is_read(tmp_path):
    text = model({1: PART}).replace("xmlns=", "xmlns:c=").replace("</", "</c:").replace("<", "<c:")
    text = text.replace("<c:/c:", "</c:").replace("<c:?", "<?")
    assert volumes_of(write(tmp_path, text)) == pytest.approx([1000])


def test_prefix_that_is_not_declared_does_not_matter_in_data_that_is_not_read(tmp_path):
    text = model({1: PART}, resources='<m:group id="7"><n:color o:value="#fff"/></m:group>')
    assert volumes_of(write(tmp_path, text)) == pytest.approx([1000])


def test_prefix_that_is_not_declared_is_refused_where_it_hides_a_part(tmp_path):
    text = model({1: PART}).replace("<object", "<c:object").replace("</object", "</c:object")
    assert (
        refusal(write(tmp_path, text))
        == "line 1 of '3D/3dmodel.model': the prefix of <object> is not declared"
    )


def test_namespace_of_an_extension_ends_with_its_element(tmp_path):
    foreign = '<group xmlns="http://example.org/"><object id="1"/></group>'
    text = model({1: PART}).replace("<resources>", f"<resources>{foreign}")
    assert volumes_of(write(tmp_path, text)) == pytest.approx([1000])


def sliced(text):
    return text.replace("<model", f'<model xmlns:s="{EXTENSION}slice/2015/07" requiredextensions="s"')


def test_slices_beside_meshes_are_left_with_a_note(tmp_path):
    path = write(tmp_path, sliced(model({1: PART})))
    assert volumes_of(path) == pytest.approx([1000])
    assert notes_of(path) == ("it needs the slice extension: its meshes were read, its slices were not",)


def test_mesh_that_stands_in_for_slices_is_refused(tmp_path):
    text = sliced(model({1: PART})).replace("<object", '<object s:meshresolution="lowres"')
    expected = "object '1' is in slices, which are not read; its mesh is a stand-in"
    assert refusal(write(tmp_path, text)) == expected


# Files after public reports, beside the project


@pytest.mark.parametrize(
    ("name", "expected", "notes"),
    [
        ("case_path", [1000], 0),
        ("nonprint_item", [1000, 1000], 2),
        ("prusa_negative", [750], 1),
        ("slice_required", [1000], 1),
        ("support_object", [1000], 1),
        ("two_roots", [1000], 0),
        ("unbound_prefix_meta", [1000], 0),
    ],
)
def test_files_after_reports_are_read(shared_data, name, expected, notes):
    path = shared_data / "reports" / f"3mf_{name}.3mf"
    if not path.is_file():
        pytest.skip("the files after reports are not here")
    assert volumes_of(path) == pytest.approx(expected)
    assert len(notes_of(path)) == notes
