"""``proximity export``: tables with every number of a log, and no partial files."""

import csv
import errno
import io
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from sealed_frames import PERIOD_NS, SESSION, frame, sealed

from proximity.message import CONTACT, FRAME, State
from proximity.recording import FrameReader, frame_reader, frame_tables

COMMAND = ("export",)
HAS_PARQUET = pytest.mark.skipif(find_spec("pyarrow") is None, reason="Parquet needs pyarrow")
KINDS = pytest.mark.parametrize("kind", ["--csv", pytest.param("--parquet", marks=HAS_PARQUET)])
HEADER_COLUMNS = [
    "session", "sequence", "state", "frame_pose_ns", "start_ns", "publish_ns", "valid_until_ns", "period_ns",
    "epoch", "missed",
]  # fmt: skip


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """Run the test in an empty folder."""
    monkeypatch.chdir(tmp_path)


def noise():
    """Return two frames of three fingers with random bits and special numbers, and their bytes."""
    rng = np.random.default_rng(5)
    message, pieces = frame(3), []
    for sequence in (0, 7):
        raw = rng.integers(0, 256, message.records.nbytes, np.uint8)
        message.records[:] = raw.view(CONTACT)
        message.records["finger"] = [0, 1, 2]
        message.records["upper"] = [np.inf, -np.inf, 1e-300]
        message.records["bend"] = np.nan
        message.header["epoch"], message.header["missed"] = 2**63, 3
        message.header["state"] = 9 if sequence else State.DEGRADED
        pieces.append(message.seal(SESSION, sequence).tobytes())
    return b"".join(pieces)


def lines_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def column_of(path, name):
    """Return a column of the log by its name in a table."""
    runs = [run["contacts"].reshape(-1) for run in FrameReader(path)]
    return np.concatenate([frame_tables.scalar_columns(run)[name] for run in runs])


def test_csv_has_a_line_a_finger_and_every_digit(run, tmp_path):
    log = tmp_path / "run.frames"
    log.write_bytes(noise())

    result = run(log, "--csv", "run.csv")

    assert (result.code, result.err) == (0, "")
    assert result.out == "run.csv: 2 frames, 6 lines\n"
    rows = lines_of((tmp_path / "run.csv").read_text())
    names = list(frame_tables.scalar_columns(np.zeros(0, CONTACT)))
    assert list(rows[0]) == HEADER_COLUMNS + list(map(frame_tables.with_unit, names))
    assert len(names) == len(CONTACT.names) + 2 * 6
    for name in names:
        expected = column_of(log, name)
        if name in frame_tables.WORDS:
            continue
        found = np.array([expected.dtype.type(row[frame_tables.with_unit(name)]) for row in rows])
        np.testing.assert_array_equal(found, expected, err_msg=name)
    assert [row["sequence"] for row in rows] == ["0"] * 3 + ["7"] * 3
    assert [row["state"] for row in rows] == ["degraded"] * 3 + ["9"] * 3
    assert {row["session"] for row in rows} == {str(SESSION)}
    assert {row["epoch"] for row in rows} == {str(2**63)}
    assert {row["period_ns"] for row in rows} == {str(PERIOD_NS)}


def test_csv_has_words_and_units(run, tmp_path):
    message = frame(2)
    message.records["flags"] = [5, 0]
    message.records["surface"], message.records["mode"], message.records["source"] = [1, 9], [1, 0], [0, 1]
    (tmp_path / "run.frames").write_bytes(message.seal(SESSION, 0).tobytes())

    first, second = lines_of(run(tmp_path / "run.frames").out)

    words = ("flags", "surface", "mode", "source")
    assert [first[name] for name in words] == ["tracked|exact", "rigid", "position", "geometry"]
    assert [second[name] for name in words] == ["", "9", "retract", "teleoperation"]
    units = {"signed_distance_m", "velocity_x_m_per_s", "bend_rate_per_s", "damping_N_s_per_m", "age_ns"}
    assert units <= set(first)


def test_parquet_has_the_same_numbers(run, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(frame_tables, "ROW_GROUP", 100)
    monkeypatch.setattr(frame_reader, "READ_BYTES", 8000)
    log = tmp_path / "run.frames"
    log.write_bytes(noise() + sealed(range(50, 100), count=5) + sealed([100], count=0))

    result = run(log, "--parquet", "run.parquet")

    assert (result.code, result.err) == (0, "")
    assert result.out == "run.parquet: 53 frames, 256 lines\n"
    file = parquet.ParquetFile(tmp_path / "run.parquet")
    assert file.metadata.num_row_groups == 3
    table = file.read()
    assert table.column_names[:10] == HEADER_COLUMNS
    for name in frame_tables.scalar_columns(np.zeros(0, CONTACT)):
        found, expected = table[frame_tables.with_unit(name)].to_numpy(), column_of(log, name)
        assert found.dtype == expected.dtype, name
        assert found.tobytes() == expected.tobytes(), name
    assert table["state"].to_pylist()[:7] == ["degraded"] * 3 + ["9"] * 3 + ["ok"]
    assert table["sequence"].to_pylist()[6:] == np.repeat(np.arange(50, 100), 5).tolist()
    assert table["session"].to_numpy().dtype == np.uint64


@pytest.mark.parametrize("options", [(), ("--csv", "-")])
def test_without_a_name_csv_goes_to_standard_output(run, tmp_path, options):
    log = tmp_path / "run.frames"
    log.write_bytes(sealed([3, 4], count=2))

    result = run(log, *options)

    assert [row["sequence"] for row in lines_of(result.out)] == ["3", "3", "4", "4"]
    assert list(tmp_path.iterdir()) == [log]


def test_damage_is_left_out_and_told(run, tmp_path):
    log = tmp_path / "run.frames"
    log.write_bytes(sealed([0]) + b"\0" * 30 + sealed([1, 2])[:-9])

    result = run(log, "--csv", "run.csv")

    size = FRAME.size(1)
    assert result.code == 0
    assert result.out == "run.csv: 2 frames, 2 lines\n"
    assert result.err.splitlines() == [
        f"proximity: {log}: damaged in 1 place, 30 bytes skipped, the first at byte {size}",
        f"proximity: {log}: {size - 9} bytes of a torn frame at the end were skipped",
    ]


@KINDS
def test_log_without_frames_is_a_table_without_lines(run, tmp_path, kind):
    log = tmp_path / "run.frames"
    log.touch()

    result = run(log, kind, "out")
    assert (result.code, result.out) == (0, "out: 0 frames, 0 lines\n")


@KINDS
def test_table_is_there_wholly_or_not_at_all(run, tmp_path, kind, monkeypatch):
    log, out = tmp_path / "run.frames", tmp_path / "out"
    log.write_bytes(sealed(range(9)))
    out.write_text("old")

    def fail(frames, calls=[]):  # noqa: B006
        calls.append(frames)
        if len(calls) > 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        return columns_of(frames)

    columns_of = frame_tables.frame_columns
    monkeypatch.setattr(frame_reader, "READ_BYTES", 2 * FRAME.size(1))
    monkeypatch.setattr(frame_tables, "frame_columns", fail)
    result = run(log, kind, out)

    assert result.code == 2
    assert result.err == f"proximity: {out}: cannot be written (No space left on device)\n"
    assert out.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == [out, log]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="there is no /dev/full")
@KINDS
def test_full_disk_is_one_sentence(run, tmp_path, kind):
    log = tmp_path / "run.frames"
    log.write_bytes(sealed(range(50)))

    result = run(log, kind, "/dev/full")

    assert result.code == 2
    assert result.err == "proximity: /dev/full: cannot be written (No space left on device)\n"


def test_missing_pyarrow_is_told_with_what_to_install(run, tmp_path, monkeypatch):
    log = tmp_path / "run.frames"
    log.write_bytes(sealed([0]))
    monkeypatch.setitem(sys.modules, "pyarrow", None)

    result = run(log, "--parquet", "run.parquet")

    assert result.code == 2
    assert result.err == (
        'proximity: Parquet needs pyarrow, which is not installed: pip install "cad-proximity[parquet]", '
        'or in a checkout pip install -e ".[parquet]"\n'
    )
    assert list(tmp_path.iterdir()) == [log]
