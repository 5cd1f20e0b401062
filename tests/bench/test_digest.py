"""Digests of answers: equal for equal answers; a difference is found and named."""

import digest
import pytest

from benchmarks.digest import queries, scenes, ticks

pytestmark = pytest.mark.filterwarnings("ignore::proximity.UnitsWarning")  # some points are far on purpose


def digests(workers=1, seed="a test"):
    scene = scenes.random_scene(scenes.generator(seed), 4, 0.1)
    triangles = queries.triangles_of(scene)
    return dict(queries.digests_of("a test", scene, triangles, 6000, workers))


def test_digests_do_not_depend_on_the_run_nor_on_workers():
    first = digests()

    assert set(first) == {f"a test/{query}" for query in queries.QUERIES}
    assert digests() == first
    assert digests(workers=2) == first


def test_other_scenes_have_other_digests_of_every_query():
    first, other = digests(), digests(seed="another test")

    assert all(first[name] != other[name] for name in first)


def test_ticks_are_digested_alike_on_every_run():
    case = ticks.TickCase("a test", lambda _: scenes.hollow_ball(0.1), 5, 60, has_paths=True)

    first = ticks.digests_of_case(case, digest.MESHES)

    assert ticks.digests_of_case(case, digest.MESHES) == first
    assert first[0] != first[1]


@pytest.mark.parametrize(
    ("now", "code", "message"),
    [
        ({"a": "1", "a/work": "2"}, 0, "2 cases compared: 0 with other answers, 0 with other work"),
        ({"a": "1", "a/work": "3"}, 0, "work differs: a/work"),
        ({"a": "2", "a/work": "2"}, 1, "ANSWERS DIFFER: a"),
        ({"a": "1", "b": "1"}, 0, "not compared: 2 cases that only one of the runs has, the first is a/work"),
        ({"b": "1"}, 1, "0 cases compared"),
    ],
)  # fmt: skip
def test_difference_is_named(now, code, message, capsys):
    assert digest.compare({"a": "1", "a/work": "2"}, now) == code

    assert message in capsys.readouterr().out
