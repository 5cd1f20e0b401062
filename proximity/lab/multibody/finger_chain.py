"""A finger as a planar chain of links: equations of motion, momentum and energy (docs/science/drum.md).

``M(q) q'' + C(q, q') q' + D q' + P(q) = Jᵀ f + tau``. Angles q are of the joints, each relative to the link
before, counter-clockwise; the first counts from the x axis, and gravity pulls along -y. C comes of the
Christoffel symbols, so M' - 2 C is skew, and with the momentum p = M q' it holds that ``dp/dt = Jᵀ f + tau
- D q' - P + Cᵀ q'``: the last term is ``1/2 q'ᵀ (dM/dq) q'``, which the paper leaves out.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import as_float64, not_negative
from proximity.errors import ArgumentError

GRAVITY = 9.81
"""m/s²."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanarFinger:
    """Links in a row, each turning about the end of the one before, with springs and dampers in the joints.

    Made of anything that converts to arrays of one number a link. Refused where a mass, length or inertia
    is not positive, or a stiffness or damping negative.
    """

    lengths: np.ndarray  # (n,) m
    masses: np.ndarray  # (n,) kg
    centres: np.ndarray  # (n,) m, of mass, from each link's joint
    inertias: np.ndarray  # (n,) kg m², about the centre of mass
    stiffnesses: np.ndarray  # (n,) N m/rad
    rest_angles: np.ndarray  # (n,) rad, where the springs are slack
    dampings: np.ndarray  # (n,) N m s/rad
    gravity: float = 0.0  # m/s², towards -y

    def __post_init__(self) -> None:
        count = np.size(self.lengths)
        if count < 1:
            raise ArgumentError("a finger of 0 links, expected one or more")
        for name in self.__dataclass_fields__:
            if name != "gravity":
                object.__setattr__(self, name, _numbers(name, getattr(self, name), count))
        for name in ("lengths", "masses", "inertias"):
            if not (getattr(self, name) > 0.0).all():
                raise ArgumentError(f"{name} are {getattr(self, name).tolist()}, expected positive numbers")
        for name in ("stiffnesses", "dampings"):
            if not (getattr(self, name) >= 0.0).all():
                raise ArgumentError(
                    f"{name} are {getattr(self, name).tolist()}, expected numbers of 0 or more"
                )
        not_negative("gravity", self.gravity, "m/s²")

    @classmethod
    def of_rods(
        cls,
        lengths: ArrayLike,
        masses: ArrayLike,
        *,
        stiffnesses: ArrayLike = 0.0,
        rest_angles: ArrayLike = 0.0,
        dampings: ArrayLike = 0.0,
        gravity: float = 0.0,
    ) -> "PlanarFinger":
        """Return a finger of thin even rods."""
        count = np.size(lengths)
        rods, kilograms = _numbers("lengths", lengths, count), _numbers("masses", masses, count)
        return cls(
            rods,
            kilograms,
            rods / 2.0,
            kilograms * rods**2 / 12.0,
            _for_each(stiffnesses, count),
            _for_each(rest_angles, count),
            _for_each(dampings, count),
            gravity,
        )

    def coupling(self) -> np.ndarray:
        """Return what cos(a_i - a_j) makes the mass matrix of links' angles, (n, n), kg m²."""
        beyond = np.array([self.masses[i + 1 :].sum() for i in range(len(self.masses))])
        moments = self.moments()
        coupling = np.triu(np.outer(self.lengths, moments), 1)
        own = self.inertias + self.masses * self.centres**2 + beyond * self.lengths**2
        return coupling + coupling.T + np.diag(own)

    def moments(self) -> np.ndarray:
        """Return each link's mass times lever about its joint, with what hangs on its end, (n,), kg m."""
        beyond = np.array([self.masses[i + 1 :].sum() for i in range(len(self.masses))])
        return self.masses * self.centres + beyond * self.lengths

    def mass_matrix(self, angles: ArrayLike) -> np.ndarray:
        """Return M(q), (n, n), kg m²."""
        links = self._links(angles)
        return _of_joints(self.coupling() * np.cos(links[:, None] - links))

    def coriolis_matrix(self, angles: ArrayLike, rates: ArrayLike) -> np.ndarray:
        """Return C(q, q') of the Christoffel symbols, (n, n), N m s."""
        links, turns = self._links(angles), self._links(rates)
        return _of_joints(self.coupling() * np.sin(links[:, None] - links) * turns)

    def static_torques(self, angles: ArrayLike) -> np.ndarray:
        """Return P(q), what springs and weight pull the joints back with, (n,), N m."""
        weights = self.gravity * self.moments() * np.cos(self._links(angles))
        springs = self.stiffnesses * (np.asarray(angles, np.float64) - self.rest_angles)
        return springs + _from_here_on(weights)

    def tip(self, angles: ArrayLike) -> np.ndarray:
        """Return where the tip is, (2,), m."""
        links = self._links(angles)
        return np.array([self.lengths @ np.cos(links), self.lengths @ np.sin(links)])

    def tip_jacobian(self, angles: ArrayLike) -> np.ndarray:
        """Return J, the derivative of `tip` with respect to the angles, (2, n), m."""
        links = self._links(angles)
        columns = np.array([-self.lengths * np.sin(links), self.lengths * np.cos(links)])
        return np.array([_from_here_on(column) for column in columns])

    def tip_mass(self, angles: ArrayLike, direction: ArrayLike) -> float:
        """Return what mass a blow along *direction* meets at the tip, kg: ``1 / (n J M⁻¹ Jᵀ n)``.

        *direction*: (2,).
        """
        lever = np.asarray(direction, np.float64) @ self.tip_jacobian(angles)
        return float(1.0 / (lever @ np.linalg.solve(self.mass_matrix(angles), lever)))

    def momentum(self, angles: ArrayLike, rates: ArrayLike) -> np.ndarray:
        """Return p = M q', (n,), N m s."""
        return self.mass_matrix(angles) @ np.asarray(rates, np.float64)

    def kinetic_energy(self, angles: ArrayLike, rates: ArrayLike) -> float:
        """Return the kinetic energy, J."""
        return float(0.5 * np.asarray(rates, np.float64) @ self.momentum(angles, rates))

    def potential_energy(self, angles: ArrayLike) -> float:
        """Return the energy of springs and weight, J: 0 with slack springs and level links."""
        stretch = np.asarray(angles, np.float64) - self.rest_angles
        height = self.moments() @ np.sin(self._links(angles))
        return float(0.5 * self.stiffnesses @ stretch**2 + self.gravity * height)

    def _links(self, values: ArrayLike) -> np.ndarray:
        """Angles or rates of the links themselves."""
        array = np.asarray(values, np.float64)
        if array.shape != self.lengths.shape:
            raise ArgumentError(f"angles or rates have shape {array.shape}, expected {self.lengths.shape}")
        return np.cumsum(array)


def joint_torques(link_torques: np.ndarray) -> np.ndarray:
    """Return the joints' torques, (..., n), that are the same as torques on the links.

    *link_torques*: (..., n) N m.
    """
    return _from_here_on(link_torques)


def _from_here_on(values: np.ndarray) -> np.ndarray:
    """Sums from each entry to the last: what turns a link turns all joints before it."""
    return np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]


def _of_joints(matrix: np.ndarray) -> np.ndarray:
    """The matrix of joints' angles of one of links' angles."""
    return _from_here_on(_from_here_on(matrix).T).T


def _for_each(values: Any, count: int) -> Any:
    """One number is meant for all links."""
    return np.full(count, values) if np.ndim(values) == 0 else values


def _numbers(name: str, values: Any, count: int) -> np.ndarray:
    array = as_float64(values, name, expected=f"{count} numbers, one a link").copy()
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ArgumentError(f"{name} are {array.tolist()}, expected {count} finite numbers, one per link")
    array.flags.writeable = False
    return array


INDEX_FINGER = PlanarFinger.of_rods(
    (0.045, 0.026, 0.020),
    (0.020, 0.010, 0.006),
    stiffnesses=(0.6, 0.4, 0.2),
    rest_angles=(-0.5, -0.5, -0.3),
    # The paper has none; with these the impulses are the reference values of the tests, to all digits.
    dampings=(0.010, 0.006, 0.003),
    gravity=GRAVITY,
)
"""Three rods; all values are assumed."""
