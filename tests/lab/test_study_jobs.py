"""Jobs of studies: each gives what the function gives that it wraps."""

import os
import sys

import numpy as np
import pytest
from project import MESHES

import proximity
from proximity.decaff.drum.drum_model import PHASE_SEED, USUAL_GEAR, with_random_phases
from proximity.decaff.glove.glove import DRUMS, Glove
from proximity.errors import ArgumentError, MissingLibraryError, ServiceError
from proximity.lab.certificate.certification import CERTIFICATE
from proximity.lab.simulation.closed_loop import decaff
from proximity.lab.simulation.devices import Decaff, Hand, TipCable
from proximity.lab.simulation.metrics import deviation
from proximity.lab.simulation.simulated_press import Setup, Wall, simulate
from proximity.lab.simulation.sweeps import Stretch, best_coupled_wall, with_transmission
from proximity.lab.sweep import node_files
from proximity.lab.sweep.field_job import FIELD
from proximity.lab.sweep.node_files import NodeFiles, file_digest
from proximity.lab.sweep.part_jobs import CHECK, REPLAY
from proximity.lab.sweep.press_job import PRESS


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Compiled scenes of a test stay in its folder."""
    monkeypatch.setattr(node_files.tempfile, "gettempdir", lambda: str(tmp_path))
    node_files._open_scenes.clear()


@pytest.fixture
def do(tmp_path):
    """Do a job for one condition."""

    def run(job, **values):
        digests = {
            name: file_digest(str(MESHES / values[name]))
            for name in ("scene", "recording")
            if str(values.get(name)).endswith((".stl", ".csv", ".glb"))
        }
        files = NodeFiles(str(MESHES), str(tmp_path / "out"), "cafe", digests)
        found = job.run(job.normalised(values), files)
        assert set(found) == {*job.measures, *job.texts}
        return found

    return run


def test_press_with_all_defaults_is_that_of_simulate(do):
    press, simulated = do(PRESS), simulate(Setup())

    assert press["force_error"] == simulated.force_error
    assert press["peak"] == simulated.felt.peak


def test_press_on_a_coupled_wall_is_tuned_unless_it_says_otherwise(do):
    tuned = do(PRESS, wall="coupled", speed=0.5, latency=0.003)
    given = do(PRESS, wall="coupled", stiffness=734.0, damping=4.4, latency=0.003)

    assert tuned["force_error"] == simulate(Setup(Wall.COUPLED, 0.5, 0.003)).force_error
    setup = Setup(Wall.COUPLED, latency=0.003, stiffness=734.0, damping=4.4)
    assert given["force_error"] == simulate(setup).force_error
    assert (given["stiffness_used"], given["damping_used"]) == (734.0, 4.4)
    wall = best_coupled_wall(Hand(), 1000.0, 0.003)
    assert (tuned["stiffness_used"], tuned["damping_used"]) == (wall.stiffness, wall.damping)


def test_press_with_one_gain_and_the_other_tuned_is_refused(do):
    """A grid of lists with "tuned" among the numbers has such conditions: their rows say so."""
    with pytest.raises(
        ArgumentError, match="stiffness and damping belong together: expected both as numbers"
    ):
        do(PRESS, wall="coupled", stiffness=500.0)


def test_peak_error_is_the_peak_less_that_of_the_real_wall(do):
    drum, real = do(PRESS, speed=0.25), do(PRESS, wall="real", speed=0.25)

    assert real["peak_error"] == 0.0
    assert drum["peak_error"] == pytest.approx(drum["peak"] - real["peak"], abs=1e-3)
    assert drum["peak_error"] < -0.1 * real["peak"]  # the step c v at the touch is blunted
    assert drum["stiffness_used"] is None and real["damping_used"] is None


def test_press_on_a_real_wall_has_no_error(do):
    assert do(PRESS, wall="real")["force_error"] == 0.0


def test_press_with_a_cable_is_that_with_its_transmission(do):
    glove = Decaff(with_random_phases(DRUMS[USUAL_GEAR], 1)[0])
    cable = TipCable.of(Glove())
    expected = deviation(decaff(Hand(), Hand().press(0.1), with_transmission(glove, cable, Stretch.SENSOR)))
    found = do(PRESS, cable_stiffness=cable.stiffness, stretch="sensor")

    assert found["force_error"] == pytest.approx(expected.error, rel=1e-12)


def test_drum_without_its_deadband_hunts(do):
    """As docs/decaff.md says: 44 mN p-p of gear4 at the worst phase."""
    swings = [do(PRESS, deadband=0.0, hold=0.5, seed=seed)["swing"] for seed in range(8)]

    assert max(swings) > 0.005
    assert do(PRESS, hold=0.5, seed=PHASE_SEED)["swing"] < 0.005


def test_check_counts_parts_repairs_and_signs(do):
    found = do(CHECK, scene="assembly.glb")
    scene = proximity.load(MESHES / "assembly.glb")

    assert found["parts"] == len(scene.parts)
    assert found["faces"] == sum(part.solid.mesh.face_count for part in scene.parts)
    assert found["without_inside"] == sum(not part.solid.has_inside for part in scene.parts)
    assert found["volume"] == pytest.approx(sum(part.solid.diagnosis.volume for part in scene.parts))


def test_replay_keeps_its_bounds_with_a_recording_and_without(do):
    recorded = do(REPLAY, scene="bracket.stl", recording="hand.csv", seconds=0.5)
    wandering = do(REPLAY, scene="box.stl", seconds=0.2)

    for found in (recorded, wandering):
        assert found["broken_bounds"] == 0
        assert 0.0 < found["tick_p50"] <= found["tick_p999"] <= found["tick_max"]
    assert recorded["touches"] > 0
    assert wandering["ticks"] == 200


def test_certificate_holds_or_does_not(do):
    holds = do(CERTIFICATE, scene="box.stl", ticks=1000, loop_seconds=0.02)

    assert holds["worst_work"] >= holds["typical_work"] > 0.0
    assert holds["faces"] == 12
    assert holds["fits"] in (0.0, 1.0)
    assert "1 ms" in holds["verdict"]


def test_field_on_a_grid_is_the_signed_distance_there(do, tmp_path):
    found = do(FIELD, scene="sphere.stl", resolution=20)
    with np.load(tmp_path / "out" / found["file"]) as field:
        distance, origin, spacing = (field[name] for name in ("distance", "origin", "spacing"))
    corner = origin + spacing * (np.array(distance.shape) - 1)
    middle = tuple(np.array(distance.shape) // 2)

    scene = proximity.load(MESHES / "sphere.stl")
    lower, upper = scene.bounds
    assert distance.shape == (20, 20, 20)
    assert (origin < lower).all() and (corner > upper).all()
    assert distance[middle] == pytest.approx(
        float(scene.signed_distance(origin + spacing * middle)), rel=1e-6
    )
    assert found["inside"] == pytest.approx((distance < 0).mean())
    assert 0.2 < found["inside"] < 0.4  # a ball fills 52 % of its box, which is 1/1.2 of the grid's side


def test_field_near_the_surface_has_points_distances_and_gradients(do, tmp_path):
    found = do(FIELD, scene="sphere.stl", sampling="surface", points=2000, spread=0.01, seed=3)
    with np.load(tmp_path / "out" / found["file"]) as field:
        points, distance, gradient = (field[name] for name in ("points", "distance", "gradient"))
    scene = proximity.load(MESHES / "sphere.stl")
    size = float((scene.bounds[1] - scene.bounds[0]).max())

    np.testing.assert_allclose(distance, scene.signed_distance(points))
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0)
    assert np.std(distance) == pytest.approx(0.01 * size, rel=0.15)


def test_field_for_vtk_reads_as_it_was_written(do, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    as_npz = do(FIELD, scene="bracket.stl", resolution=9)
    found = do(FIELD, scene="bracket.stl", resolution=9, format="vti")
    with np.load(tmp_path / "out" / as_npz["file"]) as field:
        distance, origin = field["distance"], field["origin"]
    image = pyvista.read(tmp_path / "out" / found["file"])

    assert image.dimensions == distance.shape
    assert image.origin == pytest.approx(origin)
    np.testing.assert_array_equal(image["distance"].reshape(distance.shape, order="F"), distance)


def test_field_for_zarr_reads_as_it_was_written(do, tmp_path):
    zarr = pytest.importorskip("zarr")
    found = do(FIELD, scene="sphere.stl", resolution=12, format="zarr")
    distance = zarr.open_group(str(tmp_path / "out" / found["file"]), mode="r")["distance"][:]

    assert distance.shape == (12, 12, 12)
    assert found["lowest"] == pytest.approx(float(distance.min()))


def test_format_that_cannot_be_written_is_refused(do, monkeypatch):
    with pytest.raises(ServiceError, match=r'sampling "surface" makes points, which format "vti" cannot'):
        do(FIELD, scene="box.stl", sampling="surface", format="vti")
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(MissingLibraryError, match="this format needs zarr, which is not installed: pip inst"):
        do(FIELD, scene="box.stl", resolution=4, format="zarr")


def test_scene_is_compiled_once_and_mapped_by_the_next_process(tmp_path, monkeypatch):
    files = NodeFiles(str(MESHES), str(tmp_path), "cafe", {"scene": file_digest(str(MESHES / "box.stl"))})
    first = files.scene("box.stl", "mm")
    (compiled,) = tmp_path.glob("proximity-scenes-*/*.prox")
    node_files._open_scenes.clear()  # as another process
    monkeypatch.setattr(node_files, "_check_unchanged", None)  # which would be called before compiling
    second = files.scene("box.stl", "mm")

    assert compiled.stat().st_size > 0
    assert second is not first
    assert second.signed_distance([1.0, 1.0, 1.0]) == first.signed_distance([1.0, 1.0, 1.0])


def test_damaged_compiled_scene_is_made_again(tmp_path):
    files = NodeFiles(str(MESHES), str(tmp_path), "cafe", {"scene": file_digest(str(MESHES / "box.stl"))})
    files.scene("box.stl", "mm")
    (compiled,) = tmp_path.glob("proximity-scenes-*/*.prox")
    compiled.write_bytes(compiled.read_bytes()[:100])
    node_files._open_scenes.clear()

    assert files.scene("box.stl", "mm").parts
    assert compiled.stat().st_size > 100


def test_compiled_scenes_are_bounded_the_oldest_go_first(tmp_path, monkeypatch):
    monkeypatch.setattr(node_files, "LARGEST_CACHE_BYTES", 1)
    for name in ("box.stl", "hollow_box.stl"):
        digests = {"scene": file_digest(str(MESHES / name))}
        NodeFiles(str(MESHES), str(tmp_path), "cafe", digests).scene(name, "mm")
    (left,) = tmp_path.glob("proximity-scenes-*/*.prox")

    assert left.name.startswith(file_digest(str(MESHES / "hollow_box.stl")))


def test_file_that_changed_or_is_gone_is_refused(tmp_path):
    (tmp_path / "a.stl").write_bytes((MESHES / "box.stl").read_bytes())
    files = NodeFiles(str(tmp_path), str(tmp_path), "cafe", {"scene": "0" * 64})
    with pytest.raises(ServiceError, match=r"a.stl: has changed since the study began, run the study again"):
        files.scene("a.stl", "mm")
    with pytest.raises(ServiceError, match=r"b.stl: cannot be read \(No such file or directory\) where the"):
        files.scene("b.stl", "mm")


def test_cache_of_another_user_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(node_files.os, "getuid", lambda: 12345)
    files = NodeFiles(str(MESHES), str(tmp_path), "cafe", {"scene": "0" * 64})
    with pytest.raises(ServiceError, match="belongs to another user, expected a folder of compiled scenes"):
        files.scene("box.stl", "mm")


@pytest.mark.parametrize("kind", ["link", "open to others"])
def test_a_folder_of_compiled_scenes_that_somebody_else_laid_out_is_refused(kind, tmp_path):
    """A link was followed, and a folder that others may write to was used."""
    folder, elsewhere = tmp_path / f"proximity-scenes-{os.getuid()}", tmp_path / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    if kind == "link":
        folder.symlink_to(elsewhere)
    else:
        folder.mkdir()
        folder.chmod(0o770)
    files = NodeFiles(str(MESHES), str(tmp_path), "cafe", {"scene": file_digest(str(MESHES / "box.stl"))})

    with pytest.raises(
        ServiceError, match=r"is no folder, or others may use it, expected one with mode 0700"
    ):
        files.scene("box.stl", "mm")
    assert not os.listdir(elsewhere)
