"""Numbers of a certificate: periods, percentiles, the effect of a delay, the hash."""

import make
import numpy as np
import pytest
import shapes

import proximity
from proximity import Pose, Scene, ServiceError, Solid
from proximity.lab.certificate import times
from proximity.lab.certificate.report import felt
from proximity.lab.certificate.subject import fingerprint
from proximity.scene.part import Part
from proximity.service import Histogram


def test_percentile_that_so_few_ticks_do_not_tell_is_not_told():
    assert times.percentiles(np.arange(999))["p999"] is None
    assert times.percentiles(np.arange(1000))["p999"] is not None
    assert times.percentiles(np.arange(99))["p99"] is None
    assert times.percentiles(np.arange(1)) == {"p50": None, "p99": None, "p999": None, "max": 0.0}


def test_histogram_tells_what_its_times_do():
    rng, histogram = np.random.default_rng(4), Histogram()
    taken = rng.integers(1000, 3_000_000, 5000)
    for each in taken.tolist():
        histogram.record(each)

    counted, timed = times.percentiles(histogram), times.percentiles(taken)

    for name in times.SHARES:
        assert timed[name] <= counted[name] * (1 + 1e-3) and counted[name] <= timed[name] * (1 + 1 / 16)
    over = times.over_count(histogram, 0.001)
    assert over == pytest.approx(times.over_count(taken, 0.001), rel=0.05)


def test_tick_of_exactly_the_period_is_in_time():
    times_ns = np.array([999_999, 1_000_000, 1_000_001, 5_000_000])

    assert times.over_count(times_ns, 0.001) == 2


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("0.2ms", 0.0002), ("200 µs", 0.0002), ("1kHz", 0.001), ("25 Hz", 0.04), ("1e-3s", 0.001),
    ],
)  # fmt: skip
def test_period_is_read_as_people_write_it(text, seconds):
    assert times.parse_period(text) == pytest.approx(seconds, rel=1e-12)


@pytest.mark.parametrize("text", ["", "1", "fast", "-1ms", "nanms", "11s"])
def test_what_is_no_period_is_refused(text):
    with pytest.raises(
        ServiceError, match="is not a period, expected a time or a rate such as 1ms, 200us or 1kHz"
    ):
        times.parse_period(text)


def test_forty_milliseconds_mean_what_the_paper_says():
    """The values of docs/science/paper.md: 4 mm at 0.1 m/s, 0.8 N, 6 mJ."""
    found = felt(0.040, 0.1)

    assert found["penetration"] == pytest.approx(0.004, rel=1e-12)
    assert found["force_error"] == pytest.approx(0.8, rel=1e-12)
    assert found["energy_error"] == pytest.approx(6.0e-3, rel=1e-9)


@pytest.fixture
def parts():
    rows = np.arange(12, dtype=np.int32)
    one, other = (Solid(*shapes.cube(size), name=f"{size}") for size in (0.01, 0.02))
    return [Part("one", one, Pose(), rows), Part("other", other, Pose(translation=[0.1, 0.0, 0.0]), rows)]


def changed(part, **fields):
    given = {name: getattr(part, name) for name in ("name", "solid", "pose", "source_faces")}
    return Part(**{**given, **fields})


def test_hash_does_not_depend_on_order_and_names(parts):
    renamed = [changed(parts[1], name="x"), changed(parts[0], name="y")]

    assert fingerprint(Scene(parts)) == fingerprint(Scene(renamed))
    assert len(fingerprint(Scene(parts))) == 64


@pytest.mark.parametrize(
    "fields",
    [
        {"pose": Pose(translation=[0.0, 0.0, 1e-12])},
        {"pose": Pose(shapes.rotation(3))},
        {"stiffness": 800.0},
        {"is_hidden": True},
        {"solid": Solid(*shapes.cube(0.010000001), name="moved corners")},
        {"solid": Solid(shapes.cube(0.01)[0], shapes.cube(0.01)[1][:, [1, 2, 0]], name="turned faces")},
    ],
    ids=["shifted", "turned", "soft", "hidden", "corners", "faces"],
)
def test_hash_changes_with_whatever_matters(parts, fields):
    assert fingerprint(Scene(parts)) != fingerprint(Scene([changed(parts[0], **fields), parts[1]]))


def test_hash_of_a_file_is_that_of_the_compiled_scene(tmp_path):
    scene = proximity.load(str(make.FOLDER / "box.stl"))
    scene.save(tmp_path / "box.prox")

    assert fingerprint(proximity.load(tmp_path / "box.prox")) == fingerprint(scene)
    assert fingerprint(proximity.load(str(make.FOLDER / "box.stl"))) == fingerprint(scene)
