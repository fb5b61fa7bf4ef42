"""What refinement did: the numbers behind `--report` and the line that a command prints."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class RefineStats:
    """What refinement did.

    Attributes:
        steps: how many were taken.
        kept: after how many of them the result was the best; 0 where it is the start.
        held: how many photos were held back to judge; 0 where those judge that correct.
        looks: (step, dB, SSIM) of the photos that judge, drawn from all Gaussians if they are held back, else each from
            those of the others.
        before, after: dB of the photos at the start and at the end, drawn from all Gaussians; of those held back, what
            was looked at.
        left_out: views of what was given whose photos the others contradict.
        reason: why the start is returned; empty where it is not.
    """

    steps: int = 0
    kept: int = 0
    held: int = 0
    looks: list[tuple[int, float, float]] = field(default_factory=list)
    before: float = float("nan")
    after: float = float("nan")
    left_out: tuple[int, ...] = ()
    reason: str = ""

    @property
    def text(self) -> str:
        """In a line."""
        if self.kept == 0:
            return f"refinement leaves the Gaussians as they are: {self.reason}"
        if self.held:
            return f"refined in {self.kept} steps, confirmed by {self.held} photos held back"
        first, best = self.looks[0][1], max(dB for _, dB, _ in self.looks)
        return (
            f"refined in {self.kept} steps: photos {self.before:.2f} to {self.after:.2f} dB, from the Gaussians of the"
            f" other photos {first:.2f} to {best:.2f}"
        )
