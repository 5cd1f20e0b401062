"""The report of loading: where a scene came from and what was repaired."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoadReport:
    """The file and the units that a scene came from.

    Parameters
    ----------
    path : str
        Name of the file.
    format : str
        Name of the format, for example "STL, binary".
    units : str
        Unit of the file's coordinates.
    units_declared : bool
        False: the file declares none, and *units* is that of the caller.
    notes : tuple of str
        Sentences for the user.
    """

    path: str
    format: str
    units: str
    units_declared: bool
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        units = f"{self.units} {'declared' if self.units_declared else 'assumed'}"
        return f"LoadReport({self.path!r}, {self.format}, {units}, {len(self.notes)} notes)"
