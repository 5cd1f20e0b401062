"""Where a scene came from."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoadReport:
    """Where a scene came from, and in which units.

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
