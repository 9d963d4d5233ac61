"""The candidate recipes for a scene, simplest first; the first of several equally good candidates is chosen."""

from dataclasses import dataclass

from ..compensate import Setting

SMALLEST_OPENING, LARGEST_OPENING = 5, 13
"""Windows of a morphological opening [pixel]: smaller ones leave clumps of sparkle, larger ones span two waves."""
OF_OBJECT = 0.85  # largest window over the width of the smallest object, such that the object's corners are preserved
LONG = 1.5  # least window over the width of a clump of glint, such that it reaches water on both sides of the clump


@dataclass(frozen=True)
class Candidate:
    """A recipe to try on sample tiles: a removal method, and the compensation stages before and after the removal."""

    name: str
    method: str  # "copy", or a key of `deglint.remove.METHODS`
    chain: str = "off"  # stages of the compensation, as in `deglint.compensate`; "off" for none

    @property
    def opens(self) -> bool:
        """Whether the recipe replaces glint by a morphological opening."""
        return "replace-level" in self.chain


def candidates(setting: Setting, *, width: float, clump: int) -> list[Candidate]:
    """Candidate recipes for a scene with the properties `setting`, simplest first. No opening is tried if `width`, the
    width of the smallest object to keep [pixel], is below 2.5. `clump` is the width of a clump of glint [pixel].
    """
    found = [Candidate("copy", "copy"), Candidate("wiener", "wiener")]
    targets = "targets, " if setting.delayed else ""
    found.append(Candidate("wiener, posterior mean", "wiener", f"{targets}remove, posterior"))
    sharpen = "psf:2, " if setting.psfs is not None else ""
    for window in windows(width, clump) if width >= SMALLEST_OPENING / 2 else ():
        stages = f"{sharpen}identify-level:{window}, {targets}replace-level, remove"
        found.append(Candidate(f"opening of {window} pixels, wiener", "wiener", stages))
    return found


def windows(width: float, clump: int) -> list[int]:
    """Sides of the square windows of the morphological openings to try, odd integers [pixel].

    The first is the largest that preserves objects of the width `width` [pixel], clipped to 5..13. The second is the
    smallest that reaches water beside clumps of glint of the width `clump` [pixel], only if it is at least 4 smaller.

    Examples
    --------
    >>> windows(16.0, 4), windows(16.0, 20), windows(3.2, 4)
    ([13, 7], [13], [5])
    """
    largest = _odd(min(max(OF_OBJECT * width, SMALLEST_OPENING), LARGEST_OPENING))
    needed = _odd(min(max(LONG * clump + 1, SMALLEST_OPENING), largest))
    return [largest] if needed >= largest - 2 else [largest, needed]


def _odd(size: float) -> int:
    """Largest odd integer up to `size`."""
    return int(size) - 1 + int(size) % 2
