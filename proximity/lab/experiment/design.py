"""Design of an experiment: walls, tasks with their methods, questionnaires, limits and exclusions.

`design_file` reads one from TOML; ``decaff_against_coupled.toml`` beside it explains every key.
"""

from dataclasses import dataclass, field
from enum import StrEnum

from proximity.lab.simulation.simulated_press import Wall

SIMULATED = "simulated observer"
"""Apparatus of a participant who is no person."""


class Kind(StrEnum):
    """Kinds of tasks."""

    STIFFER = "stiffer"
    """Two intervals: which was stiffer?"""
    REAL = "real"
    """Two intervals, one on a real wall: which was that?"""
    RATING = "rating"
    """One interval: a number for its stiffness."""
    CONTACT = "contact"
    """One interval: time and depth of the first contact, as measured; nothing is asked."""
    FREE = "free"
    """One interval of free exploration; nothing is asked."""


class Procedure(StrEnum):
    """Methods that choose the level of a trial."""

    CONSTANT = "constant"
    STAIRCASE = "staircase"
    QUEST = "quest+"


class Varied(StrEnum):
    """Stimulus that the levels of a task are of."""

    STIFFNESS = "stiffness"
    """As a share beyond the task's stiffness."""
    DAMPING = "damping"
    """As a share beyond the damping of the condition."""
    LATENCY = "latency"
    """In seconds beyond the latency of the condition."""
    SPEED = "speed"
    """Of the approach, in m/s, of both intervals."""


CHOICES = (Kind.STIFFER, Kind.REAL)
"""Tasks of two intervals, with an answer that is right or wrong."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A wall that is compared with others, and how simulated observers are expected to do on it."""

    name: str
    wall: Wall
    latency: float = 0.001  # s, of forces or of distances
    # N/m, gain of a coupled wall that displays a rigid surface; of others what simulated observers rate it as
    stiffness: float = 1500.0
    damping: float = 2.0  # N s/m, gain of a coupled wall; of a surface whose task gives none
    threshold: float = 0.2  # expected: level at which an answer is right half-way between chance and always
    correct: float = 0.5  # expected: probability to tell the wall from the real one


@dataclass(frozen=True, slots=True)
class Task:
    """A task, done on every condition."""

    name: str
    kind: Kind
    procedure: Procedure
    trials: int  # a condition, without practice and catch trials
    levels: tuple[float, ...]
    varied: Varied
    stiffness: float | None  # N/m, of the surface that is displayed; None: rigid
    damping: float | None  # N s/m, of that surface on every condition; None: that of the condition
    speed: float  # m/s, of the approach that is asked for
    practice: int
    catch: int  # trials that nobody fails who attends
    catch_level: float
    blocks: int
    question: str
    instructions: str


@dataclass(frozen=True, slots=True)
class Question:
    """A question of a questionnaire: a number or one of several choices, never free text."""

    key: str
    text: str
    lowest: float = 0.0
    highest: float = 100.0
    choices: tuple[str, ...] = ()
    is_after: bool = False

    def fits(self, answer: object) -> bool:
        """Whether an answer is one that the question takes."""
        if self.choices:
            return answer in self.choices
        return (
            isinstance(answer, int | float)
            and not isinstance(answer, bool)
            and self.lowest <= answer <= self.highest
        )

    @property
    def expected(self) -> str:
        """The answers that it takes, in words."""
        return " or ".join(self.choices) or f"a number from {self.lowest:g} to {self.highest:g}"


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of every interval, whatever the rest of the design says."""

    force: float = 5.0  # N at the fingertip; beyond, the trial ends
    seconds: float = 10.0  # longest interval


@dataclass(frozen=True, slots=True)
class Schedule:
    """Times that a session is planned with, and its breaks."""

    trial_seconds: float = 8.0
    question_seconds: float = 10.0
    break_minutes: float = 1.0
    break_every: int = 4  # blocks


@dataclass(frozen=True, slots=True)
class Exclusions:
    """Rules by which data are left out, written before there are any."""

    catch_correct: float = 0.0  # share of catch trials that must be right, else the participant is out
    longest_response: float = 1e9  # s, else the trial is out
    stopped_trials: float = 1.0  # share of trials that limits may end, else the participant is out


@dataclass(frozen=True, slots=True)
class Observers:
    """Simulated participants: spread among them, their psychometric function, and their hand."""

    spread: float = 0.1  # standard deviation of a participant's log10 threshold
    interaction: float = 0.0  # the same, of each condition of a participant
    # Deviation of the logarithm of what is felt, which answers follow; 0: they follow the thresholds.
    felt_noise: float = 0.0
    width: float = 0.6  # log10 units from 5 to 95 % of the psychometric function
    lapse: float = 0.02
    rating_noise: float = 0.1  # standard deviation of the log10 of a rating
    speed_noise: float = 0.2  # of the approach, as a share


@dataclass(frozen=True, slots=True)
class Design:
    """An experiment, as its file has it."""

    title: str
    seed: int
    participants: int
    consent: str
    conditions: tuple[Condition, ...]
    tasks: tuple[Task, ...]
    welcome: str = ""
    pause: str = ""
    goodbye: str = ""
    questions: tuple[Question, ...] = ()
    limits: Limits = field(default_factory=Limits)
    schedule: Schedule = field(default_factory=Schedule)
    exclusions: Exclusions = field(default_factory=Exclusions)
    observers: Observers = field(default_factory=Observers)
    sha256: str = ""  # of the file
    text: str = ""

    def condition(self, name: str) -> Condition:
        """Return a condition by its name."""
        return next(one for one in self.conditions if one.name == name)

    def task(self, name: str) -> Task:
        """Return a task by its name."""
        return next(one for one in self.tasks if one.name == name)
