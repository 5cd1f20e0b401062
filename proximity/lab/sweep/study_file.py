"""Reader of study files: from TOML to the conditions of a study, with every mistake named by its line."""

import glob
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from proximity.checks import as_number, is_whole
from proximity.lab.sweep.design import ConditionSet, Design, Exclusion, Factor, Job, Kind, Levels, Span
from proximity.lab.sweep.node_files import file_digest
from proximity.service.config.table_fields import REQUIRED, Range, Table, shown
from proximity.service.config.toml_document import Document, Path, read_document

TABLES = ("study", "factors", "conditions", "exclude", "plot")
STUDY_KEYS = ("name", "job", "design", "samples", "seed", "measures")
PLOT_KEYS = ("measure", "x", "lines", "columns", "points")
POINTS = ("median", "worst")
SPAN_KEYS = ("from", "to", "count", "spacing")
BOUND_KEYS = ("above", "below")
COUNTS = Range("", 1, 1_000_000)
SAMPLES = Range("", 1, 100_000_000)
SEEDS = Range("", 0, 2**32 - 1)
POINT_SIZE = 3


@dataclass(frozen=True, slots=True)
class PlotChoice:
    """What the first plot of the page shows; None: chosen by the size of effects."""

    measure: str | None = None
    x: str | None = None
    lines: str | None = None
    columns: str | None = None
    points: str = POINTS[0]  # of all conditions at one x


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A study file that was read."""

    path: str
    name: str  # empty where the file gives none
    conditions: ConditionSet
    measures: tuple[str, ...]  # that the page shows; the first ranks conditions
    plot: PlotChoice

    @property
    def job(self) -> Job:
        """What is done for each condition."""
        return self.conditions.job

    @property
    def folder(self) -> str:
        """Folder that paths in the file start from."""
        return os.path.dirname(os.path.abspath(self.path))


def read_study(path: str | os.PathLike[str], jobs: Mapping[str, Job], *, with_files: bool = True) -> Study:
    """Return what a study file says.

    *with_files*: whether files that factors name are looked for; else its conditions cannot be used.
    """
    document = read_document(path, "a study")
    study = _StudyReader(document, os.fsdecode(path), jobs, with_files).study()
    document.raise_complaints()
    return study


class _StudyReader:
    """The tables of one study, one after the other."""

    def __init__(self, document: Document, path: str, jobs: Mapping[str, Job], with_files: bool) -> None:
        self._document, self._path, self._jobs, self._with_files = document, path, jobs, with_files
        self._folder = os.path.dirname(os.path.abspath(path))
        self._digests: dict[str, str] = {}
        Table(document, (), document.data, TABLES)  # complains of others

    def study(self) -> Study:
        """The whole file."""
        table = Table(self._document, ("study",), self._document.data.get("study", {}), STUDY_KEYS)
        name = table.text("name", "", meaning="what the study is called")
        job = self._jobs.get(table.one_of("job", REQUIRED, tuple(self._jobs)) or "")
        design = Design(table.one_of("design", Design.GRID, tuple(Design)))
        is_latin = design == Design.LATIN
        samples = table.whole("samples", REQUIRED if is_latin else 1, SAMPLES)
        seed = table.whole("seed", 0, SEEDS)
        measures = table.texts("measures", None, meaning="what is measured")
        if table.has("samples") and not is_latin:
            table.complain("samples", f'is of a Latin hypercube, expected design = "{Design.LATIN}" as well')
        self._document.raise_complaints()  # without a job nothing below can be read
        assert job is not None, "a job that is not there was complained of"
        for measure in measures or ():
            if measure not in job.measures:
                table.complain("measures", f"has {measure!r}, expected some of {', '.join(job.measures)}")
        levels = self._levels(job, is_latin=is_latin)
        rows = self._rows(job, design, levels)
        self._check_complete(job, levels, rows)
        self._check_together(job, levels, rows)
        conditions = ConditionSet(
            job, design, levels, rows, samples, seed, self._exclusions(job), self._digests
        )
        return Study(self._path, name, conditions, tuple(measures or job.measures), self._plot(job))

    def _levels(self, job: Job, *, is_latin: bool) -> dict[str, Levels]:
        content = self._document.data.get("factors", {})
        path: Path = ("factors",)
        self._table(path, content, job)
        return {
            name: self._values((*path, name), value, job.factors[name], is_latin=is_latin)
            for name, value in (content.items() if isinstance(content, dict) else ())
            if name in job.factors
        }

    def _rows(self, job: Job, design: Design, levels: Mapping[str, Levels]) -> tuple[dict[str, Any], ...]:
        listed = self._document.data.get("conditions")
        if (listed is not None) != (design == Design.LIST):
            expected = "[[conditions]] as well" if listed is None else f'design = "{Design.LIST}" as well'
            self._document.complain(
                ("study", "design") if listed is None else ("conditions",),
                f'study.design is "{design}", expected {expected}',
            )
            return ()
        rows = []
        for path, content in self._listed("conditions"):
            self._table(path, content, job)
            row = {}
            for name, value in content.items():
                if name not in job.factors:
                    continue
                values = self._values((*path, name), value, job.factors[name], is_latin=False)
                row[name] = _first(values)
                if name in levels:
                    self._document.complain((*path, name), f"{name} is in [factors] too, expected it once")
                elif isinstance(values, Span) or len(values) > 1:
                    self._document.complain((*path, name), f"{name} has several values, expected one a row")
            rows.append(row)
        return tuple(rows)

    def _check_complete(
        self, job: Job, levels: Mapping[str, Levels], rows: tuple[dict[str, Any], ...]
    ) -> None:
        for name, factor in job.factors.items():
            given = name in levels or (rows and all(name in row for row in rows))
            if factor.default is REQUIRED and not given:
                self._document.complain(
                    ("factors",), f"factors.{name} is missing: the job {job.name} needs it in every condition"
                )

    def _check_together(
        self, job: Job, levels: Mapping[str, Levels], rows: tuple[dict[str, Any], ...]
    ) -> None:
        """Complain of a factor with a number where one that belongs to it has none in any condition."""
        for index, row in enumerate(rows or ({},)):
            chosen = {**levels, **{name: (value,) for name, value in row.items()}}
            numbers = [name for name in job.together if _has_number(chosen.get(name, ()))]
            missing = [name for name in job.together if name not in numbers]
            if numbers and missing:
                path: Path = ("conditions", index) if numbers[0] in row else ("factors",)
                self._document.complain(
                    (*path, numbers[0]),
                    f"{numbers[0]} is a number, but {missing[0]} is {job.factors[missing[0]].absent}: "
                    f"{' and '.join(job.together)} belong together, expected both as numbers or neither",
                )
                return

    def _exclusions(self, job: Job) -> tuple[Exclusion, ...]:
        found = []
        for path, content in self._listed("exclude"):
            self._table(path, content, job)
            words, bounds = {}, {}
            for name, value in content.items():
                if isinstance(value, dict):
                    table = Table(self._document, (*path, name), value, BOUND_KEYS)
                    anything = Range("")
                    low = table.number("above", -math.inf, anything)
                    bounds[name] = (low, table.number("below", math.inf, anything))
                elif name in job.factors:
                    levels = self._values((*path, name), value, job.factors[name], is_latin=False)
                    words[name] = levels if isinstance(levels, tuple) else levels.values()
            if not content:
                self._document.complain(path, "[[exclude]] is empty, expected factors and their values")
            found.append(Exclusion(words, bounds))
        return tuple(found)

    def _plot(self, job: Job) -> PlotChoice:
        table = Table(self._document, ("plot",), self._document.data.get("plot", {}), PLOT_KEYS)
        factors, measures = tuple(job.factors), tuple(job.measures)
        numbers = [name for name in factors if job.factors[name].kind in (Kind.NUMBER, Kind.WHOLE)]
        return PlotChoice(
            table.one_of("measure", None, measures),
            table.one_of("x", None, (*numbers, *measures)),
            table.one_of("lines", None, factors),
            table.one_of("columns", None, factors),
            table.one_of("points", POINTS[0], POINTS),
        )

    def _listed(self, name: str) -> list[tuple[Path, dict[str, Any]]]:
        listed = self._document.data.get(name, [])
        if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
            self._document.complain((name,), f"{name} is no list of tables, expected [[{name}]] above each")
            return []
        return [((name, index), content) for index, content in enumerate(listed)]

    def _table(self, path: Path, content: Any, job: Job) -> None:
        """Complain of factors that the job does not have; say so where another job has them."""
        others = {
            name: other.name
            for other in self._jobs.values()
            for name in (content if isinstance(content, dict) else ())
            if name in other.factors and name not in job.factors
        }
        for name, owner in others.items():
            self._document.complain(
                (*path, name), f"{name} is a factor of the job {owner}, but not of {job.name}"
            )
        Table(self._document, path, content, (*job.factors, *others))

    def _values(self, path: Path, value: Any, factor: Factor, *, is_latin: bool) -> Levels:
        if isinstance(value, dict) and factor.kind in (Kind.NUMBER, Kind.WHOLE):
            return self._span(path, value, factor, is_latin=is_latin)
        is_point = factor.kind == Kind.POINT and isinstance(value, list) and value and _are_numbers(value)
        listed = value if isinstance(value, list) and not is_point else [value]
        if not listed:
            self._document.complain(path, f"{path[-1]} is an empty list, expected at least one value")
        found = [each for one in listed for each in self._value(path, one, factor)]
        if len(set(found)) < len(found):
            self._document.complain(path, f"{path[-1]} has a value twice, expected values that differ")
        return tuple(found) or (factor.default,)

    def _value(self, path: Path, value: Any, factor: Factor) -> list[Any]:
        """Values that are meant by one: several where it is a pattern of files, none where it is unfit."""
        if factor.absent and value == factor.absent:
            return [None]
        if factor.kind == Kind.FILE:
            return self._files(path, value, factor)
        if factor.kind == Kind.WORD:
            is_fit, expected = value in factor.words, " or ".join(f'"{word}"' for word in factor.words)
        elif factor.kind == Kind.POINT:
            is_fit = isinstance(value, list) and len(value) == POINT_SIZE and _are_numbers(value)
            value, expected = tuple(value) if is_fit else value, f"three numbers ({factor.accepted.unit})"
        else:
            number = as_number(value)
            is_fit = factor.accepted.holds(number) and (factor.kind == Kind.NUMBER or is_whole(value))
            value = float(value) if is_fit and factor.kind == Kind.NUMBER else value
            expected = f"a {factor.kind} {factor.accepted}"
        if is_fit:
            return [value]
        also = f' or "{factor.absent}"' if factor.absent else ""
        self._document.complain(path, f"{path[-1]} is {shown(value)}, expected {expected}{also}")
        return []

    def _files(self, path: Path, value: Any, factor: Factor) -> list[str]:
        if value in factor.words or not self._with_files:
            return [value]
        if not isinstance(value, str) or not value.strip():
            self._document.complain(path, f"{path[-1]} is {shown(value)}, expected a file, as text in quotes")
            return []
        is_pattern = glob.has_magic(value) and not os.path.exists(os.path.join(self._folder, value))
        names = sorted(glob.glob(value, root_dir=self._folder, recursive=True)) if is_pattern else [value]
        names = [name for name in names if os.path.isfile(os.path.join(self._folder, name))]
        if not names:
            missing = "matches no file" if is_pattern else "is not there"
            self._document.complain(path, f"{path[-1]}: {value!r} {missing} in {self._folder}")
        for name in names:
            if name not in self._digests:
                self._digests[name] = file_digest(os.path.join(self._folder, name))
        return names

    def _span(self, path: Path, value: dict[str, Any], factor: Factor, *, is_latin: bool) -> Span:
        table = Table(self._document, path, value, SPAN_KEYS)
        first = table.number("from", REQUIRED, factor.accepted)
        last = table.number("to", REQUIRED, factor.accepted)
        count = table.whole("count", None if is_latin else REQUIRED, COUNTS)
        is_log = table.one_of("spacing", "linear", ("linear", "log")) == "log"
        if REQUIRED in (first, last, count):
            return Span(1.0, 1.0, 1)
        if is_log and min(first, last) <= 0.0:
            table.complain("spacing", 'is "log", expected from and to above zero')
            is_log = False
        return Span(first, last, count, is_log, factor.kind == Kind.WHOLE)


def _are_numbers(value: list[Any]) -> bool:
    return all(math.isfinite(as_number(each)) for each in value)


def _has_number(levels: Levels) -> bool:
    return isinstance(levels, Span) or any(value is not None for value in levels)


def _first(levels: Levels) -> Any:
    return levels.first if isinstance(levels, Span) else levels[0]
