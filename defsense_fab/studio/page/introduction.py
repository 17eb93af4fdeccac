"""A walk through the studio, a step for each mode."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

#: The mode, and what one does there.
STEPS = (
    ("Device", "**The body.** Its sizes are sliders here; its material, cord and printer are"
     " chosen from the catalogue. All that you change is written to `device.toml`, and *Undo*"
     " takes it back."),
    ("Poses", "**What it must sense.** Each pose holds some regions and moves others. Choose one,"
     " and turn its gizmo: the body follows. Then press *Simulate the poses*, here or in"
     " *Optimise*."),
    ("Inside", "**Where it stretches.** A section through the body, coloured by its stretch in a"
     " pose. The heat map tells where the next cord would help most."),
    ("Cords", "**The sensors.** Press *Draw by hand* and draw a line along the body, or *Propose a"
     " cord*. Choose a cord, and drag its points: the expected error follows. What breaks a limit"
     " turns red."),
    ("Optimise", "**Better paths.** The optimiser moves the cords that are not locked, and the"
     " error falls. Take its cords, or keep yours."),
    ("Make", "**The parts.** *Build everything* cuts the body along the cords' planes, grooves the"
     " faces, and writes parts, cut list and guide. Step through the assembly, and export it all."),
    ("Measure", "**It senses.** Without a printed device its digital twin stands in: record a"
     " session, train, and watch the live model."),
)  # fmt: skip


class Introduction:
    """In a folder of the panel; `enter` goes to a mode. Steps of modes that are not there are left
    out."""

    def __init__(self, gui: Any, modes: Collection[str], enter: Callable[[str], None]) -> None:
        self._steps = [step for step in STEPS if step[0] in modes]
        self._enter, self._at = enter, 0
        self._folder = gui.add_folder("Introduction", visible=False)
        with self._folder:
            self._text = gui.add_markdown("")
            self._next = gui.add_button("Next")
            self._next.on_click(lambda _: self.go(self._at + 1))
            gui.add_button("Back").on_click(lambda _: self.go(self._at - 1))
            gui.add_button("Leave the introduction").on_click(lambda _: self.leave())

    def begin(self) -> None:
        """From the first step."""
        self.go(0)

    def go(self, at: int) -> None:
        """To a step; behind the last one it is over."""
        if at >= len(self._steps):
            self.leave()
            return
        self._at = max(at, 0)
        mode, text = self._steps[self._at]
        self._text.content = f"{self._at + 1} of {len(self._steps)}: {text}"
        self._next.label = "Next" if self._at + 1 < len(self._steps) else "Done"
        self._folder.visible = True
        self._enter(mode)

    def leave(self) -> None:
        """Away with it; it can be begun again."""
        self._folder.visible = False
