"""The report of loading: where a scene came from and what was repaired."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoadReport:
    """The file and the units that a scene came from.

    Parameters
    ----------
    path : str
        Of the file.
    format : str
        As people say it: "STL, binary".
    units : str
        Of the file's coordinates.
    units_declared : bool
        False: the file names none, *units* is what the caller said.
    notes : tuple of str
        Sentences a user should know.
    """

    path: str
    format: str
    units: str
    units_declared: bool
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        units = f"{self.units} {'declared' if self.units_declared else 'assumed'}"
        return f"LoadReport({self.path!r}, {self.format}, {units}, {len(self.notes)} notes)"
