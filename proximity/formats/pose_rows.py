"""Reader of poses from a CSV file."""

import csv
from pathlib import Path

from proximity.errors import ArgumentError, PoseError
from proximity.pose import Pose

COLUMNS = ("position", "x", "y", "z", "qx", "qy", "qz", "qw")


def read_poses(path: Path, metres: float) -> tuple[list[float], list[Pose]]:
    """Read positions and poses, scene from part, from a CSV file.

    *metres*: length of the unit of x, y and z, m. Raises `ArgumentError` with the line.
    """
    positions, poses, line = [], [], 1
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream)
            for row in reader:
                line = reader.line_num
                position, *numbers = (float(row[name]) for name in COLUMNS)
                positions.append(position)
                poses.append(Pose.from_quaternion(numbers[3:], [metres * each for each in numbers[:3]]))
    except OSError as failure:
        reason = f"{path}: cannot be read ({failure.strerror or failure})"
    except PoseError as unfit:
        reason = f"{path}, line {line}: {unfit}"
    except (KeyError, TypeError, ValueError, csv.Error):
        reason = f"{path}, line {line}: expected CSV with the columns {', '.join(COLUMNS)}"
    else:
        return positions, poses
    raise ArgumentError(reason)
