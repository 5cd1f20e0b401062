"""STEP files of other programs, with external part files, and conversions that would not terminate."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
import step_text
from mesh_reading import read as read_file
from mesh_reading import refusal as refusal_of
from mesh_reading import volume, world, write
from project import MESHES

from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats.step import conversion, product_structure
from proximity.formats.step.step_records import StepText

BOX = step_text.box_step((1, 2, 3), name="lid")
ASSEMBLY = (MESHES / "assembly.step").read_text("ascii")
RECORDS = {match[1]: match[0] for match in re.finditer(r"(#\d+)=[^\n]*;\n", ASSEMBLY)}
HEAD, TAIL = ASSEMBLY[: ASSEMBLY.index("DATA;\n") + 6], "ENDSEC;\nEND-ISO-10303-21;\n"
IN_USES = re.findall(r"(#\d+)=(?:CONTEXT_DEPENDENT_SHAPE|SHAPE_DEFINITION)_REPRESENTATION", ASSEMBLY)


@pytest.fixture(scope="module", autouse=True)
def one_process():
    """Convert all files in one process; a new one would import OpenCASCADE for each."""
    with conversion.converter():
        yield


@pytest.fixture
def own_process(monkeypatch):
    """Convert in a process that starts and ends with the test."""
    monkeypatch.setattr(conversion._shared, "library", None)


def read(tmp_path, text, name="part.step", **options):
    return read_file(tmp_path, name, text, **options)


def refusal(tmp_path, text):
    return refusal_of(write(tmp_path, "part.step", text))


@pytest.mark.parametrize(
    "data",
    [
        BOX + "SIGNATURE;\nMIIB+abc/==\nENDSEC;\n",
        BOX + "SIGNATURE;\nMIIB\nENDSEC;\nSIGNATURE;\nMIIC\nENDSEC;\n\n",
        BOX + " \r\n" * 500,
        BOX + "\0" * 300,
        BOX + "\x1a",
        "\ufeff" + BOX,
    ],
)
def test_signed_padded_and_marked_files_are_read_without_a_word(tmp_path, data):
    contents = read(tmp_path, data)
    assert len(contents.geometries[0].faces) == 12
    assert len(contents.notes) == 1, "only that on the tolerance"


def test_other_text_after_the_end_is_ignored_with_a_note(tmp_path):
    assert "6 bytes after END-ISO-10303-21 were ignored" in read(tmp_path, BOX + "hello").notes


def test_shell_that_no_product_uses_is_left_out_with_a_note(tmp_path):
    shell = "#901=CLOSED_SHELL('',(#902));\n#902=ADVANCED_FACE('',(),#903,.T.);\n#903=PLANE('',#1);\n"
    contents = read(tmp_path, BOX.replace(TAIL, shell + TAIL))
    assert contents.notes[0] == "1 faces were left out: no product uses their shells"
    assert len(contents.geometries[0].faces) == 12


def test_solids_without_names_are_called_after_what_is_above_them(tmp_path):
    solids = re.sub(r"PRODUCT\('(base|pin|lid)','\w+'", "PRODUCT('SOLID','SOLID'", ASSEMBLY)
    names = [geometry.name for geometry in read(tmp_path, solids).geometries]
    assert names == ["base", "lid", "pin_left", "pin_right"]
    numbered = re.sub(r"(OCCURRENCE)\('\w+','\w+'", r"\1('1','NAUO1'", solids)
    names = [geometry.name for geometry in read(tmp_path, numbered).geometries]
    assert names == ["assembly", "assembly_2", "assembly_3", "assembly_4"]
    alone = step_text.box_step((1, 2, 3), name="Open CASCADE STEP translator 7.7 1")
    assert read(tmp_path, alone, "flange.step").geometries[0].name == "flange"


def test_product_gives_its_name_where_its_use_has_a_number():
    text = ASSEMBLY.replace("OCCURRENCE('pin_left','pin_left'", "OCCURRENCE('7','NAUO7'")
    header = (
        b'{"nodes": [{"name": "NAUO7", "children": [1]}, {"name": "=>[0:1:1:5]", "mesh": 0}],'
        b' "meshes": [{"name": "SOLID"}]}'
    )
    named = product_structure.with_names_of_products(header, StepText(text))
    assert b'{"name": "pin", "mesh": 0}' in named


TWICE = """\
#800=SHAPE_REPRESENTATION('machine',(#13,#683),#9);
#801=PRODUCT('machine','machine','',(#3));
#802=PRODUCT_DEFINITION_FORMATION('','',#801);
#803=PRODUCT_DEFINITION('design','',#802,#4);
#804=PRODUCT_DEFINITION_SHAPE('','',#803);
#805=SHAPE_DEFINITION_REPRESENTATION(#804,#800);
""" + "".join(
    f"#8{k}1=NEXT_ASSEMBLY_USAGE_OCCURRENCE('{name}','{name}','',#803,#699,$);\n"
    f"#8{k}2=PRODUCT_DEFINITION_SHAPE('','',#8{k}1);\n"
    f"#8{k}3=ITEM_DEFINED_TRANSFORMATION('','',#13,{place});\n"
    f"#8{k}4=(REPRESENTATION_RELATIONSHIP('','',#696,#800)REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION"
    f"(#8{k}3)SHAPE_REPRESENTATION_RELATIONSHIP());\n"
    f"#8{k}5=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#8{k}4,#8{k}2);\n"
    for k, (name, place) in enumerate((("left", "#683"), ("right", "#691")), start=1)
)
"""The assembly of the file, used twice in another one."""


def test_parts_of_one_name_carry_the_names_of_their_assemblies(tmp_path):
    contents = read(tmp_path, ASSEMBLY.replace(TAIL, TWICE + TAIL))
    names = [geometry.name for geometry in contents.geometries]
    assert names == [
        f"{side}/{part}" for side in ("left", "right") for part in ("base", "lid", "pin", "pin_2")
    ]
    assert "2 of its meshes are called 'left/pin'; from the second on they are numbered" in contents.notes


@pytest.mark.parametrize(
    ("encoding", "name", "words"),
    [
        ("utf-8", "Gehäuse 海绵座", None),
        ("latin-1", "Gehäuse", "Windows-1252"),
        ("latin-1", "Größe Ø10", "Windows-1252"),
        ("cp1252", "Plaque d’appui – côté droit", "Windows-1252"),
        ("gb18030", "海绵座", "GB18030"),
        ("gb18030", "镀锌垫片 M6", "GB18030"),
        ("shift_jis", "ハウジング", "Shift-JIS"),
        ("shift_jis", "歯車", "Shift-JIS"),
        ("shift_jis", "表", "Shift-JIS"),  # its second byte is a backslash
        ("cp1251", "Корпус", "Windows-1251"),
    ],
)
def test_name_that_is_not_utf8_keeps_its_letters_and_is_noted(tmp_path, encoding, name, words):
    # Regression: Geh㴳e, without a note.
    contents = read(tmp_path, step_text.box_step((1, 2, 3), name=name).encode(encoding))
    assert contents.geometries[0].name == name
    note = f"its text is not UTF-8, and was read as {words}: names may have other letters"
    assert (contents.notes[:-1] == (note,)) if words else (len(contents.notes) == 1)


def test_bytes_that_no_encoding_has_stay_legible(tmp_path):
    contents = read(tmp_path, BOX.encode().replace(b"lid", b"lid \x81 \xe4"))
    assert contents.geometries[0].name.startswith("lid ") and contents.geometries[0].name.endswith(" ä")
    assert "was read as Latin-1" in contents.notes[0]


def test_product_and_use_of_one_name_find_each_other_beyond_ascii(tmp_path):
    text = ASSEMBLY.replace("'pin'", "'Bolzen_ö'")
    numbered = re.sub(r"(OCCURRENCE)\('pin_left','pin_left'", r"\1('7','NAUO7'", text)
    solids = numbered.replace("MANIFOLD_SOLID_BREP('Bolzen_ö'", "MANIFOLD_SOLID_BREP('SOLID'")
    assert "Bolzen_ö" in [geometry.name for geometry in read(tmp_path, solids).geometries]


def test_part_file_in_another_encoding_is_noted_by_its_name(tmp_path):
    text, lid = with_lid_in_file("lid.stp")
    (tmp_path / "lid.stp").write_bytes(lid.replace("'lid'", "'Dübel'").encode("latin-1"))
    contents = read(tmp_path, text)
    assert "Dübel" in [geometry.name for geometry in contents.geometries]
    assert contents.notes[0].startswith("its part 'lid.stp': its text is not UTF-8")


def reached(*roots, records=RECORDS):
    """Return the records reachable from the roots, in order."""
    found, waiting = set(), list(roots)
    while waiting:
        number = waiting.pop()
        if number not in found:
            found.add(number)
            waiting += re.findall(r"#\d+", records[number].partition("=")[2])
    return "".join(records[number] for number in sorted(found, key=lambda number: int(number[1:])))


def with_lid_in_file(name, kind="reference"):
    """Return the sample assembly with its lid in another file, and that file."""
    product, shape = re.search(r"(#\d+)=PRODUCT_DEFINITION\('design','',#454", ASSEMBLY)[1], "#452"
    lid = re.search(rf"(#\d+)=SHAPE_DEFINITION_REPRESENTATION\(#\d+,{shape}\)", ASSEMBLY)[1]
    empty = RECORDS | {shape: f"{shape}=SHAPE_REPRESENTATION('lid',(#13),#9);\n"}
    text = reached(*IN_USES, records=empty)
    documents = f"#9001=DOCUMENT_TYPE('');\n#9002=DOCUMENT_FILE('{name}','it''s',$,#9001,'',$);\n"
    if kind == "reference":
        documents += (
            "#9003=IDENTIFICATION_ROLE('external document id and location',$);\n"
            f"#9004=EXTERNAL_SOURCE(IDENTIFIER('{name}'));\n"
            f"#9005=APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT('{name}',#9003,#9004,(#9002));\n"
            f"#9007=APPLIED_DOCUMENT_REFERENCE(#9002,'',({product}));\n"
            "#9008=ROLE_ASSOCIATION(#9009,#9007);\n#9009=OBJECT_ROLE('mandatory',$);\n"
        )
    else:
        text = text.replace(
            f"{product}=PRODUCT_DEFINITION('design','',#454,#4)",
            f"{product}=PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS('design','',#454,#4,(#9002))",
        )
    return HEAD + text + documents + TAIL, HEAD + reached(lid) + TAIL


@pytest.mark.parametrize("kind", ["reference", "associated"])
@pytest.mark.parametrize("name", ["lid.stp", "parts/lid.STEP"])
def test_part_in_a_file_of_its_own_is_not_lost(tmp_path, kind, name):
    # Regression: an assembly without its lid, without a note.
    text, lid = with_lid_in_file(name, kind)
    (tmp_path / "parts").mkdir()
    (tmp_path / name).write_text(lid)
    expected, found = (read(tmp_path, each).geometries for each in (ASSEMBLY, text))
    assert sorted(part.name for part in found) == sorted(part.name for part in expected)
    corners, expected_corners = (
        np.sort(
            np.concatenate([part.vertices @ part.pose.rotation.T + part.pose.translation for part in parts]),
            axis=0,
        )
        for parts in (found, expected)
    )
    assert np.array_equal(corners, expected_corners)


def test_part_files_of_part_files_and_other_units_are_read(tmp_path):
    text, _ = with_lid_in_file("sub/assembly.stp")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "assembly.stp").write_text(with_lid_in_file("lid.stp")[0])
    (tmp_path / "sub" / "lid.stp").write_text(step_text.box_step((1, 1, 1), "in", "cover"))
    contents = read(tmp_path, text)
    assert [part.name for part in contents.geometries].count("pin") == 1
    (cover,) = (part for part in contents.geometries if part.name == "cover")
    assert np.allclose(np.ptp(cover.vertices, axis=0), 0.0254)
    assert len(contents.geometries) == 7
    assert contents.units == "in, mm"


def test_part_file_with_a_shape_for_its_validation_properties_is_read(tmp_path):
    # Regression: "has 2 products that are part of no other", for part files of Creo and NX.
    text, lid = with_lid_in_file("lid.stp")
    product, shape = re.search(r"=SHAPE_DEFINITION_REPRESENTATION\((#\d+),(#\d+)\)", lid).groups()
    aspect = (
        f"#9101=SHAPE_ASPECT('','solid data',{product},.F.);\n"
        "#9102=PROPERTY_DEFINITION('','shape with properties',#9101);\n"
        f"#9103=SHAPE_DEFINITION_REPRESENTATION(#9102,{shape});\n"
    )
    (tmp_path / "lid.stp").write_text(lid.replace(TAIL, aspect + TAIL))
    assert sorted(part.name for part in read(tmp_path, text).geometries) == ["base", "lid", "pin", "pin_2"]


def test_part_file_that_is_named_once_for_each_use_is_read(tmp_path):
    # Regression: an AssertionError, for assemblies of Creo with a part used twice.
    text, lid = with_lid_in_file("lid.stp")
    (tmp_path / "lid.stp").write_text(lid)
    again = re.sub(r"#90(?!01)", "#91", text[text.index("#9002=") : text.index(TAIL)])
    assert len(read(tmp_path, text.replace(TAIL, again + TAIL)).geometries) == 4


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lid.stp", "its part 'lid.stp' beside it cannot be read (No such file or directory)"),
        ("/etc/lid.stp", "its part '/etc/lid.stp' is not in the folder of this file or below"),
        ("../lid.stp", "its part '../lid.stp' is not in the folder of this file or below"),
        ("part.step", "its part 'part.step' is part of itself"),
        ("cut.stp", "its part 'cut.stp': it does not end with END-ISO-10303-21: it is cut off"),
    ],
)
def test_part_file_that_cannot_be_read_refuses_the_whole(tmp_path, name, message):
    (tmp_path / "cut.stp").write_text(BOX[:-30])
    assert refusal(tmp_path, with_lid_in_file(name)[0]).startswith(message)


def test_drawing_of_a_part_that_is_there_is_not_looked_for(tmp_path):
    text, lid = with_lid_in_file("lid.stp")
    text = text.replace("#452=SHAPE_REPRESENTATION('lid',(#13),#9);\n", "")
    missing = "".join(
        record for number, record in RECORDS.items() if number in lid and f"\n{number}=" not in text
    )
    contents = read(tmp_path, text.replace("#9001=", missing + "#9001="))
    assert len(contents.geometries) == 4


# Assemblies

# A wheel of two tyres, used twice; a list of materials names a glue without a shape.
NESTED = """
#1=PRODUCT_DEFINITION('car','',#90,#91); #2=PRODUCT_DEFINITION('wheel','',#90,#91);
#3=PRODUCT_DEFINITION('tyre','',#90,#91); #4=PRODUCT_DEFINITION('glue','',#90,#91);
#11=PRODUCT_DEFINITION_SHAPE('','',#1); #12=PRODUCT_DEFINITION_SHAPE('','',#2);
#13=PRODUCT_DEFINITION_SHAPE ('it''s; #1','' , #3 );
#21=SHAPE_DEFINITION_REPRESENTATION(#11,#31); #22=SHAPE_DEFINITION_REPRESENTATION(#12,#32);
#23=SHAPE_DEFINITION_REPRESENTATION(#13,#33);
#31=SHAPE_REPRESENTATION('',(#80),#81); #32=SHAPE_REPRESENTATION('',(#80),#81);
#33=SHAPE_REPRESENTATION('',(#80),#81); #34=ADVANCED_BREP_SHAPE_REPRESENTATION('',(#80,#35),#81);
#35=MANIFOLD_SOLID_BREP('',#36); #37=SHAPE_REPRESENTATION_RELATIONSHIP('','',#33,#34);
#41=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#1,#2,$); #42=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#1,#2,$);
#43=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#2,#3,$); #44=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#2,#3,$);
#45=NEXT_ASSEMBLY_USAGE_OCCURRENCE /* ' ; */ ('glue','','',#1,#4,$);
#51=PRODUCT_DEFINITION_SHAPE('','',#41); #52=PRODUCT_DEFINITION_SHAPE('','',#42);
#53=PRODUCT_DEFINITION_SHAPE('','',#43); #54=PRODUCT_DEFINITION_SHAPE('','',#44);
#61=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#71,#51); #62=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#72,#52);
#63=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#73,#53); #64=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#74,#54);
#73=SHAPE_REPRESENTATION_RELATIONSHIP('','',#32,#33);
"""


def without(kind, number):
    """Return the sample assembly without one of the records of a kind."""
    record = list(re.finditer(rf"#\d+={kind}\(.*\n", ASSEMBLY))[number]
    return ASSEMBLY[: record.start()] + ASSEMBLY[record.end() :]


USE, SHAPE = "NEXT_ASSEMBLY_USAGE_OCCURRENCE", "SHAPE_DEFINITION_REPRESENTATION"
PLACE = "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"


@pytest.mark.parametrize("number", [0, 3])
def test_part_that_lost_its_place_or_shape_is_not_left_out_or_put_elsewhere(tmp_path, number):
    use = re.findall(rf"#\d+(?=={USE})", ASSEMBLY)[number]
    assert refusal(tmp_path, without(PLACE, number)).startswith(f"{USE} {use} has no {PLACE}: a part")
    words = rf"PRODUCT_DEFINITION #\d+ is part of an assembly, but has no {SHAPE}"
    assert re.match(words, refusal(tmp_path, without(SHAPE, number)))


def test_fewer_parts_than_the_assemblies_hold_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "part.step"
    path.write_text(ASSEMBLY)
    assert (
        len(formats.read_geometries(path).geometries)
        == product_structure.count_bodies(StepText(ASSEMBLY))
        == 4
    )
    monkeypatch.setattr(product_structure, "count_bodies", lambda text: 5)
    with pytest.raises(
        MeshFormatError, match="its assemblies hold 5 parts, but OpenCASCADE could read 4 only"
    ):
        formats.read_geometries(path)


def test_uses_are_expanded():
    assert product_structure.count_bodies(StepText(NESTED)) == 4


def test_files_that_place_shapes_in_other_ways_are_left_alone():
    text = NESTED.replace(
        "#61=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#71,#51);", "#61=MAPPED_ITEM('',#1,#2);"
    )
    assert product_structure.count_bodies(StepText(text)) == 0


def test_product_that_contains_itself_is_refused():
    text = NESTED.replace("('','','',#2,#3,$)", "('','','',#2,#1,$)", 1)
    with pytest.raises(MeshFormatError, match=r"PRODUCT_DEFINITION #[12] is part of itself, expected a tree"):
        product_structure.count_bodies(StepText(text))


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("m", 1.0), ("in", 0.0254)])
def test_step_declares_its_unit_and_triangles_know_their_cad_face(tmp_path, unit, metres):
    data = step_text.box_step((1, 2, 3), unit, name="lid").encode()
    contents = read(tmp_path, data, units="km")
    assert (contents.format, contents.units, contents.units_declared) == ("STEP", unit, True)
    (geometry,) = contents.geometries
    assert geometry.name == "lid"
    assert volume(geometry) == pytest.approx(6 * metres**3, rel=1e-6)  # in single precision
    assert np.bincount(geometry.source_faces).tolist() == [2] * 6
    assert contents.notes == (
        "curved faces are approximated within 0.01 mm by flat triangles: distances are exact to the "
        "triangles",
    )


STYLES = (
    "COLOUR_RGB('',{red},0.,0.)", "FILL_AREA_STYLE_COLOUR('',{last})", "FILL_AREA_STYLE('',({last}))",
    "SURFACE_STYLE_FILL_AREA({last})", "SURFACE_SIDE_STYLE('',({last}))",
    "SURFACE_STYLE_USAGE(.BOTH.,{last})", "PRESENTATION_STYLE_ASSIGNMENT(({last}))",
    "STYLED_ITEM('color',({last}),{item})",
)  # fmt: skip


def colour(first, item, red):
    """Return records that colour a face, each referring to the one before."""
    return "".join(
        f"#{number}={record.format(red=red, last=f'#{number - 1}', item=item)};\n"
        for number, record in enumerate(STYLES, first)
    )


def test_colours_of_faces_do_not_change_the_numbers_of_cad_faces(tmp_path):
    # Regression: if faces had colours, most triangles had indices of triangles as CAD faces.
    faces = re.findall(r"(#\d+) = ADVANCED_FACE", BOX)
    context = re.search(r"(#\d+) = \( GEOMETRIC", BOX)[1]
    styles = colour(9000, faces[3], "1.") + colour(9100, faces[5], "0.5")
    styles += f"#9990=MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',(#9007,#9107),{context});\n"
    (part,) = read(tmp_path, BOX.replace(TAIL, styles + TAIL)).geometries
    assert part.source_faces.tolist() == np.repeat(np.arange(6), 2).tolist()


def test_step_with_free_form_faces_is_noted_if_the_deviation_is_unknown(tmp_path, monkeypatch):
    text = step_text.box_step((1, 2, 3), "mm", name="lid")
    point = re.search(r"(#\d+) = CARTESIAN_POINT", text)[1]
    surface = (
        f"#901=B_SPLINE_SURFACE_WITH_KNOTS('',1,1,(({point},{point}),({point},{point})),.UNSPECIFIED.,.F.,.F.,"
        ".F.,(2,2),(2,2),(0.,1.),(0.,1.),.UNSPECIFIED.);\n"
    )
    text = text.replace(TAIL, surface + TAIL)
    (note,) = read(tmp_path, text.encode(), cache=False).notes
    assert note.startswith("curved faces are approximated within 0.01 mm")
    monkeypatch.setattr("proximity.formats.step.deviation.read_bodies", lambda _: [])
    _, note, unbounded = read(tmp_path, text.encode(), cache=False).notes
    assert note.startswith("on free-form faces, which the file has, OpenCASCADE may exceed")
    assert unbounded == (
        "the deviation of lid from its CAD surfaces is not bounded: no solid of the file has its faces"
    )


def test_step_without_units_is_read_in_those_of_the_caller(tmp_path):
    contents = read(tmp_path, step_text.box_step((1, 2, 3), None), "part.stp", units="cm")
    assert (contents.units, contents.units_declared) == ("cm", False)
    assert contents.geometries[0].vertices.max() == pytest.approx(0.03, rel=1e-6)


def test_step_assembly_keeps_products_and_places(shared_data):
    contents = formats.read_geometries(shared_data / "cad" / "box_sides.STEP")
    names = [geometry.name for geometry in contents.geometries]
    assert names == [
        *("box_base", "side_long", "side_long_2", "side_short", "side_short_B"),
        *("gusset", "gusset_2", "gusset_3", "gusset_4", "box_top"),
    ]
    gussets = contents.geometries[5:9]
    assert all(gusset.vertices is gussets[0].vertices for gusset in gussets)
    corners = np.concatenate([world(geometry) for geometry in contents.geometries])
    assert np.allclose(np.ptp(corners, axis=0), [0.18415, 0.1143, 0.09525], atol=1e-6)  # inches in the file


def test_step_part_agrees_with_its_stl_twin(shared_data):
    step = formats.read_geometries(shared_data / "cad" / "featuretype.STEP").geometries[0]
    stl = formats.read_geometries(shared_data / "cad" / "featuretype.STL", units="in").geometries[0]
    assert np.allclose(step.vertices.min(axis=0), stl.vertices.min(axis=0), atol=1e-7)
    assert np.allclose(step.vertices.max(axis=0), stl.vertices.max(axis=0), atol=1e-7)
    assert volume(step) == pytest.approx(volume(stl), rel=2e-3)  # two tessellations


def test_finer_step_tolerance_gives_more_triangles(shared_data):
    path = shared_data / "cad" / "featuretype.STEP"
    coarse, fine = (
        len(formats.read_geometries(path, step_tolerance=tolerance).geometries[0].faces)
        for tolerance in (1e-3, 1e-5)
    )
    assert fine > coarse


@pytest.mark.parametrize(("radius", "tolerance"), [(1_000, 1e-5), (1_000_000, 1e-5)])
def test_huge_ball_is_meshed_coarsely_with_both_numbers(tmp_path, monkeypatch, radius, tolerance):
    # Regression: minutes, and gigabytes.
    monkeypatch.setattr(conversion, "MAX_FACE_TRIANGLES", 15_000)
    contents = read(tmp_path, step_text.ball_step(radius))
    (ball,) = contents.geometries
    assert 10_000 < len(ball.faces) < 20_000
    factor = radius / 1000.0
    (note,) = (note for note in contents.notes if "approximated" in note)
    reached_mm = float(re.search(r"within ([\d.e+]+) mm, not 0.01 mm", note)[1])
    assert 0.3 * factor < reached_mm < 1.0 * factor
    assert f"{1e6 * factor:.2g}"[0] == re.search(r"up to (\d)", note)[1]
    assert "expected at most 5,000,000 and 15,000" in note
    error = np.abs(np.linalg.norm(ball.vertices, axis=1) - radius * 1e-3)
    assert error.max() < reached_mm * 1e-3


def test_ball_of_a_usual_size_is_meshed_as_asked_for(tmp_path):
    contents = read(tmp_path, step_text.ball_step(5))
    assert contents.notes[-1].startswith("curved faces are approximated within 0.01 mm by flat triangles")


@pytest.mark.usefixtures("own_process")
def test_conversion_over_its_limits_is_refused_with_them(tmp_path, monkeypatch):
    monkeypatch.setattr(conversion, "MAX_SECONDS", 0)
    assert re.match(
        r"OpenCASCADE takes more than 0 s or 8 GB to mesh it within [\d.e-]+ mm, expected less",
        refusal_of(write(tmp_path, "part.step", BOX), cache=False),
    )


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_worker_and_its_folder_go_with_a_parent_that_is_killed(tmp_path):
    (tmp_path / "ball.step").write_text(step_text.ball_step(100))
    folder = tmp_path / "temporary"
    folder.mkdir()
    code = "import sys; from proximity import formats; formats.read_geometries(sys.argv[1])"
    parent = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "ball.step")], env=os.environ | {"TMPDIR": str(folder)}
    )
    workers = wait_for(lambda: len(found := workers_in(folder)) == 1 and found)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    wait_for(lambda: not workers_in(folder) and not list(folder.iterdir()))
    assert all(not Path(f"/proc/{worker}").exists() for worker in workers)


def workers_in(folder):
    """Return the ids of conversion processes whose output is below the folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if "work" in (process / "cmdline").read_text().split("\0") and str(folder) in os.readlink(
                process / "fd" / "1"
            ):
                found.append(process.name)
        except OSError:
            continue
    return found


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return result


@pytest.mark.usefixtures("own_process")
def test_no_temporary_folder_stays_after_a_refusal(tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    refusal(tmp_path, BOX.replace("ADVANCED_FACE", "ADVANCED_FACX", 1))
    assert not list(folder.iterdir())


def test_assembly_of_a_public_report_is_read_the_same_a_second_time(shared_data):
    path = shared_data / "assemblies" / "as1-oc-214.stp"
    first, second = (formats.read_geometries(path) for _ in range(2))
    assert len(first.geometries) == 18 and first.notes == second.notes
    for one, other in zip(first.geometries, second.geometries, strict=True):
        assert one.name == other.name and np.array_equal(world(one), world(other))
