"""Choice of the sign method of a body, which is checked by sampling.

- *pseudo-normal*: the surface is closed and oriented. The normal of the nearest feature gives the sign. Near
  faces that are folded onto their neighbours, pass through others or are as thin as a line, the winding
  number gives it.
- *winding number*: the surface is closed but much of it intersects itself, or it has small holes.
- *none*: a sheet, or a surface with large holes. It has no inside, so distances have no sign.
"""

from enum import Enum

from proximity.kernels import entries, layout
from proximity.mesh.topology import Topology
from proximity.scene.model.assembly import Model


class SignMethod(Enum):
    """The method that decides the sign of a distance.

    PSEUDONORMAL: by the normal of the nearest face, edge or corner of a closed and oriented surface.
    WINDING_NUMBER: by the number of times the surface winds around the point, if it is closed but intersects
    itself, or has small holes. NONE: distances have no sign, as the part has no inside.
    """

    PSEUDONORMAL = "pseudo-normal"
    WINDING_NUMBER = "winding number"
    NONE = "none"


_KERNEL_SIGN = {
    SignMethod.PSEUDONORMAL: layout.SIGN_PSEUDONORMAL,
    SignMethod.WINDING_NUMBER: layout.SIGN_WINDING,
    SignMethod.NONE: layout.SIGN_NONE,
}


def kernel_sign(method: SignMethod) -> int:
    """Return the constant ``layout.SIGN_*`` of a sign method."""
    return _KERNEL_SIGN[method]


REASONS = {
    layout.REASON_NO_AREA: "no face has an area: there is no inside, so distances have no sign",
    layout.REASON_AGREES: (
        "closed and oriented; agrees with the winding number at {asked} of {asked} sample points"
    ),
    layout.REASON_DISAGREES: (
        "closed and oriented, but it intersects itself or has shells that face the wrong way: the nearest "
        "face and the winding number disagree at {against} of {asked} sample points"
    ),
    layout.REASON_MANY_FACES: "closed, but edges have more than two faces",
    layout.REASON_SMALL_HOLES: (
        "not closed, but the winding number is clear below {share:.0%} of the surface"
    ),
    layout.REASON_OPEN: "not closed: there is no inside, so distances have no sign",
}
"""Text for each reason of the choice of a sign method."""
EXCEPTIONS = (
    "; {count} faces are as thin as a line, or next to such faces: there the winding number decides",
    "; {count} faces are folded over, or pass through others, or next to such faces: there the winding "
    "number decides",
)
"""Texts about faces of a part with pseudo-normals near which the winding number gives the sign."""
FLIPPED = "; all faces were flipped: they ran clockwise seen from outside"


def choose_sign(model: Model, topology: Topology) -> tuple[SignMethod, str]:
    """Choose the sign method of the only part of *model*, and write it there.

    Return the method and the reason.
    """
    reason, asked, against, *exceptions, share = entries.choose_sign(
        model.packed, topology.is_watertight, topology.is_balanced
    )
    why = REASONS[reason].format(asked=asked, against=against, share=share)
    for text, count in zip(EXCEPTIONS, exceptions, strict=True):
        why += text.format(count=count) if count else ""
    method = next(method for method, sign in _KERNEL_SIGN.items() if sign == model.parts["sign"][0])
    return method, why
