"""3MF: all placements are read, holes are subtracted, supports left out, and small files read quickly."""

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
    """Return a closed box with outward faces."""
    vertices, faces = shapes.cube()
    vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0)
    return np.asarray(lower) + vertices * (np.asarray(upper, dtype=float) - lower), faces


PART = box((0, 0, 0), (20, 10, 5))
SLOT = box((4, -1, 2), (8, 11, 6))  # 4 x 10 x 3 mm of it are in the part
PEG = box((12, 4, -1), (14, 6, 9))


def joined(*meshes):
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [np.asarray(faces) + start for (_, faces), start in zip(meshes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def model(objects, items=((1, HERE),), resources=""):
    return mesh_files.threemf_model(objects, items).replace("</resources>", resources + "</resources>")


def write(folder, text, root="3D/3dmodel.model", **others):
    """Write a 3MF of a root model and other files by name."""
    path = folder / "part.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {root: text, **others}.items():
            archive.writestr(name, data)
    return path


def slic3r(*kinds, key="volume_type", last=11):
    """Return settings that make each 12 triangles of object 1 a volume."""
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


def volumes_of(scene):
    """Return the volume of each part, mm³."""
    return [part.solid.diagnosis.volume * 1e9 for part in scene.parts]


# Placements

SHIFT = "1 0 0 0 1 0 0 0 1 {} {} 0"
SMALL = box((0, 0, 0), (1, 1, 1))
COMPONENT_IN_FILE = '<component p:path="/3D/part{}.model" objectid="{}"/>'


def components(own_id, *targets):
    """Return an object of components in a row along y."""
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


@pytest.mark.parametrize("ids", [(1, 2), (1, 1)])  # unique per model file only
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


def of_bambu(negative, matrix, **subtypes):
    """Return the part with other objects, by the settings of Bambu Studio."""
    resources = assembly((1, HERE), (2, matrix))
    return model({1: PART, 2: negative}, [(9, HERE)], resources), {BAMBU: bambu(_1="normal_part", **subtypes)}


def with_pegs(kind="model", item='<item objectid="2"'):
    """Return the part and a peg as objects, with the type and item of the peg."""
    text = model({1: PART, 2: PEG}, [(1, HERE), (2, HERE)]).replace('<item objectid="2"', item)
    return text.replace('name="part2" type="model"', f'name="part2" type="{kind}"')


def with_a_prefix(text):
    text = text.replace("xmlns=", "xmlns:c=").replace("</", "</c:").replace("<", "<c:")
    return text.replace("<c:/c:", "</c:").replace("<c:?", "<?")


def named(*targets):
    """Return relationships that name models."""
    return {"_rels/.rels": RELATIONSHIPS.format("".join(map(RELATIONSHIP.format, targets)))}


def required(name, prefix, text):
    return text.replace("<model", f'<model xmlns:{prefix}="{EXTENSION}{name}" requiredextensions="{prefix}"')


def in_another_file(name):
    """Return a part in another file, whose name in its component differs in spelling."""
    component = f'<component p:path="{name}" objectid="1"/>'
    text = model({}, [(9, HERE)], f'<object id="9"><components>{component}</components></object>')
    return required("production/2015/06", "p", text), {"3D/objects/a.MODEL": model({1: PART}, [])}


OPEN_SLOT = SLOT[0], SLOT[1][:-1]
PLAIN, SLOTTED, PEGGED = model({1: PART}), model({1: joined(PART, SLOT)}), model({1: joined(PART, PEG)})
TURN = "0.6 0.8 0 -0.8 0.6 0 0 0 1 {} {} {}"
FLUSH = assembly((1, TURN.format(1, 2, 3)), (2, TURN.format(1 + 0.6 * 4, 2 + 0.8 * 4, 5)))
FLUSH_IN_MESH = model({1: joined(PART, box((4, 0, 2), (8, 10, 5)))}, [(1, TURN.format(3, 1, 4))])
FLUSH_PART = model({1: PART, 2: box((0, 0, 0), (4, 10, 3))}, [(9, TURN.format(3, 1, 4))], FLUSH)
SUBTRACTED = "negative volumes were subtracted from 1 of its parts"
LEFT_OUT = "volumes that are not parts of the shape were left out: {} (1)"
TOO_OPEN = "not all negative volumes could be subtracted from 1 of its parts: some are too"
UNDECLARED = '<m:group id="7"><n:color o:value="#fff"/></m:group>'
FOREIGN = '<group xmlns="http://example.org/"><object id="1"/></group>'
UNPRINTABLE = (
    '1 of the 2 items of its build (the first: item 2) should not be printed (printable="0"); they were read '
    "all the same"
)
REAL = {**named("/3D/real.model"), "3D/3dmodel.model": model({1: PEG})}
SLICES = required("slice/2015/07", "s", PLAIN)
SLICES_NOTE = "it needs the slice extension: its meshes were read, its slices were not"
IN_MESH, AS_PART = {SLIC3R: slic3r("ModelPart", "NegativeVolume")}, {"_2": "negative_part"}
PARTS = {  # content; its volumes, mm³; start of its note; points of the part, m, and distances
    "negative volume of PrusaSlicer": (
        (SLOTTED, IN_MESH), [880], SUBTRACTED, [[0.006, 0.005, 0.004]], [0.002]),
    "negative part of Bambu Studio, mirrored": (
        of_bambu(SLOT, "-1 0 0 0 1 0 0 0 1 12 0 0", **AS_PART), [880], SUBTRACTED),
    **{f"hole flush with the surface leaves no skin, {how}": (
           (text, settings), [880], SUBTRACTED, [[0.006, 0.005, 0.005], [0.006, 0, 0.004]], [0.002, 0.002])
       for how, text, settings in (
           ("in one mesh", FLUSH_IN_MESH, IN_MESH),
           ("as components", FLUSH_PART, {BAMBU: bambu(_1="normal_part", **AS_PART)}))},
    **{f"volume that steers a slicer: {shown}": (
           (PEGGED, {SLIC3R: slic3r("ModelPart", kind)}), [1000], LEFT_OUT.format(shown))
       for kind, shown in (("ParameterModifier", "modifier"), ("SupportBlocker", "support blocker"),
                           ("SupportEnforcer", "support enforcer"))},
    "modifier of old settings": (
        (PEGGED, {SLIC3R: slic3r("0", "1", key="modifier")}), [1000], LEFT_OUT.format("modifier")),
    "volumes of Bambu Studio that are no parts": (
        (model({1: PART, 2: SLOT, 3: PEG}, [(9, HERE)], assembly((1, HERE), (2, HERE), (3, HERE))),
         {BAMBU: bambu(_1="normal_part", _2="modifier_part", _3="support_blocker")}),
        [1000], LEFT_OUT.format("modifier (1), support blocker")),
    "negative volume that is open": (
        (model({1: joined(PART, OPEN_SLOT)}),
         {SLIC3R: slic3r("ModelPart", "NegativeVolume").replace('lastid="23"', 'lastid="22"')}),
        [1000], TOO_OPEN),
    **{f"object of type {kind}": ((with_pegs(kind), {}), [1000], LEFT_OUT.format(kind))
       for kind in ("support", "solidsupport", "other")},
    "surface": ((PLAIN.replace('type="model"', 'type="surface"'), {}), [1000], None),
    "item that should not be printed": (
        (with_pegs(item='<item printable="0" objectid="2"'), {}), [1000, 40], UNPRINTABLE),
    "relationship that names the root model": ((PLAIN, REAL, "3D/real.model"), [1000], None),
    **{f"root model called {root}": (
           (PLAIN, named(root.replace("\\", "/").replace("%20", " ").upper()), root), [1000], None)
       for root in ("part.model", "3D\\3dmodel.model", "/3d/3DMODEL.model", "3D/my%20part.model")},
    **{f"component in {name}": (in_another_file(name), [1000], None)
       for name in ("3d/Objects/A.model", "\\3D\\objects\\a.model", "3D/objects/./a.model")},
    "model that nothing refers to": ((PLAIN, {"3D/old.model": "not XML"}), [1000], None),
    **{f"core of {uri}": ((PLAIN.replace(CORE, uri), {}), [1000], None)
       for uri in (EXTENSION + "2013/01", EXTENSION + "core/2013/12", CORE)},
    "core behind a prefix": ((with_a_prefix(PLAIN), {}), [1000], None),
    "known extension with another prefix": ((required("production/2015/06", "q", PLAIN), {}), [1000], None),
    "prefix that is not declared, of data that are not read": (
        (PLAIN.replace("</resources>", f"{UNDECLARED}</resources>"), {}), [1000], None),
    "namespace of an extension, which ends with its element": (
        (PLAIN.replace("<resources>", f"<resources>{FOREIGN}"), {}), [1000], None),
    "slices beside meshes": ((SLICES, {}), [1000], SLICES_NOTE),
}  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_parts_of_a_file_have_their_volumes_and_what_is_none_is_said(tmp_path, name):
    (text, others, *root), expected, note, *asked = PARTS[name]
    path = write(tmp_path, text, *root, **others)
    scene = proximity.load(path)
    assert volumes_of(scene) == pytest.approx(expected)
    notes = formats.read_geometries(path).notes
    assert len(notes) == (note is not None) and all(found.startswith(note) for found in notes)
    if asked:
        assert scene.parts[0].solid.signed_distance(asked[0]) == pytest.approx(asked[1], abs=1e-12)


def test_faces_of_a_hole_lead_to_the_triangles_of_the_file(tmp_path):
    path = write(tmp_path, SLOTTED, **IN_MESH)
    geometry = formats.read_geometries(path).geometries[0]
    vertices, faces = joined(PART, SLOT)
    corners = geometry.vertices[geometry.faces] * 1e3
    given = vertices[faces][geometry.source_faces]
    normals = np.cross(given[:, 1] - given[:, 0], given[:, 2] - given[:, 0])
    offsets = np.einsum("fkj,fj->fk", corners - given[:, :1], normals)
    assert np.abs(offsets).max() < 1e-9
    assert set(geometry.source_faces.tolist()) > set(range(4))


def test_negative_part_of_bambu_studio_is_a_hole_at_every_copy(tmp_path):
    items = [(9, "0 1 0 -1 0 0 0 0 1 100 0 0"), (9, HERE)]
    resources = assembly((1, HERE), (2, "1 0 0 0 1 0 0 0 1 4 0 2"))
    text = model({1: PART, 2: box((0, -1, 0), (4, 11, 4))}, items, resources)
    text = text.replace('id="2" name="part2" type="model"', 'id="2" type="other"')
    scene = proximity.load(write(tmp_path, text, **{BAMBU: bambu(_1="normal_part", **AS_PART)}))
    assert volumes_of(scene) == pytest.approx([880, 880])
    points = np.array([[0.1 - 0.005, 0.006, 0.004], [0.006, 0.005, 0.004], [0.1 - 0.005, 0.015, 0.004]])
    assert np.sign(scene.signed_distance(points)).tolist() == [1, 1, -1]


def test_settings_without_other_volumes_change_nothing(tmp_path):
    plain = formats.read_geometries(write(tmp_path, PEGGED)).geometries[0]
    contents = formats.read_geometries(write(tmp_path, PEGGED, **{SLIC3R: slic3r("ModelPart", "ModelPart")}))
    assert contents.notes == ()
    np.testing.assert_array_equal(contents.geometries[0].faces, plain.faces)


def test_subtractions_that_would_take_hours_are_left_with_a_note(tmp_path, monkeypatch):
    monkeypatch.setattr(volumes, "_MAX_WORK", 1023)
    path = write(tmp_path, SLOTTED, **IN_MESH)
    assert formats.read_geometries(path).notes[0].startswith("not all negative volumes could be subtracted")


REFUSED = [
    (PLAIN, {SLIC3R: slic3r("SupportBlocker")}, "it has no parts: " + LEFT_OUT.format("support blocker")),
    (PLAIN, {SLIC3R: slic3r("ModelPart", last=12)}, "the volumes of 'part1' have more than its 12 triangles"),
    (PLAIN, {SLIC3R: slic3r("ModelPart").replace('"0"', '"9"', 1).replace("11", "13")},
     "a volume has triangles 9 to 13"),
    (PLAIN, {SLIC3R: slic3r("ModelPart").replace("firstid", "first")},
     f"line 1 of '{SLIC3R}': <volume> has no firstid"),
    (PLAIN, {SLIC3R: slic3r("ModelPart")[:-9]}, f"'{SLIC3R}' is not XML (no element found"),
    (PLAIN, {SLIC3R: "<!DOCTYPE a>" + slic3r("ModelPart")}, f"'{SLIC3R}' has a document type"),
    (PLAIN, {SLIC3R: slic3r("ModelPart") + " " * 60_000_000}, "its models of "),
    (PLAIN, named("/3D/other.model"), "its _rels/.rels names the models ['/3d/other.model']"),
    (PLAIN, {**named("/a.model", "/3D/3dmodel.model"), "a.model": model({1: PEG})},
     "its _rels/.rels names the models ['/3d/3dmodel.model', "),
    (PLAIN.replace("<object", "<c:object").replace("</object", "</c:object"), {},
     "line 1 of '3D/3dmodel.model': the prefix of <object> is not declared"),
    (SLICES.replace("<object", '<object s:meshresolution="lowres"'), {},
     "object '1' is in slices, which are not read; its mesh is a stand-in"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "others", "words"), REFUSED, ids=[words[:40] for *_, words in REFUSED])
def test_settings_and_models_that_lie_are_refused(tmp_path, text, others, words):
    assert refusal(write(tmp_path, text, **others)).startswith(words)
