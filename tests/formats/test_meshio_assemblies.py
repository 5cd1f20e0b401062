"""Assemblies of STEP files: all uses of parts are there and placed, or the file is refused."""

import re

import pytest
from project import MESHES

from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats.step import product_structure

ASSEMBLY = (MESHES / "assembly.step").read_text("ascii")

# A wheel of two tyres, used twice; a list of material names a glue that has no shape.
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
    """The sample assembly without one of the records of a kind."""
    record = list(re.finditer(rf"#\d+={kind}\(.*\n", ASSEMBLY))[number]
    return ASSEMBLY[: record.start()] + ASSEMBLY[record.end() :]


@pytest.mark.parametrize("number", [0, 3])
def test_part_that_lost_its_place_is_not_left_out(tmp_path, number):
    path = tmp_path / "part.step"
    path.write_text(without("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", number))
    use = re.findall(r"#\d+(?==NEXT_ASSEMBLY_USAGE_OCCURRENCE)", ASSEMBLY)[number]
    with pytest.raises(
        MeshFormatError,
        match=rf"NEXT_ASSEMBLY_USAGE_OCCURRENCE {use} has no CONTEXT_DEPENDENT_SHAPE_REPRESENTATION: a part",
    ):
        formats.read_geometries(path)


@pytest.mark.parametrize("number", [0, 3])
def test_product_that_lost_its_shape_is_not_put_elsewhere(tmp_path, number):
    path = tmp_path / "part.step"
    path.write_text(without("SHAPE_DEFINITION_REPRESENTATION", number))
    with pytest.raises(
        MeshFormatError,
        match=r"PRODUCT_DEFINITION #\d+ is part of an assembly, but has no SHAPE_DEFINITION_REPRESENTATION",
    ):
        formats.read_geometries(path)


def test_fewer_parts_than_the_assemblies_hold_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "part.step"
    path.write_text(ASSEMBLY)
    assert len(formats.read_geometries(path).geometries) == product_structure.count_bodies(ASSEMBLY) == 4
    monkeypatch.setattr(product_structure, "count_bodies", lambda text: 5)
    with pytest.raises(
        MeshFormatError, match="its assemblies hold 5 parts, but OpenCASCADE could read 4 only"
    ):
        formats.read_geometries(path)


def test_uses_are_expanded():
    assert product_structure.count_bodies(NESTED) == 4


def test_files_that_place_shapes_in_other_ways_are_left_alone():
    text = NESTED.replace(
        "#61=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#71,#51);", "#61=MAPPED_ITEM('',#1,#2);"
    )
    assert product_structure.count_bodies(text) == 0


def test_product_that_contains_itself_is_refused():
    text = NESTED.replace("('','','',#2,#3,$)", "('','','',#2,#1,$)", 1)
    with pytest.raises(MeshFormatError, match=r"PRODUCT_DEFINITION #[12] is part of itself, expected a tree"):
        product_structure.count_bodies(text)
