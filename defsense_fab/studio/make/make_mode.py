"""The mode in which the device is optimised and built."""

from __future__ import annotations

from ...pipeline.artifacts.build_folder import build_folder
from ...pipeline.artifacts.layout import LAYOUT, load_layout
from ..edits.cords import take_cords
from ..workbench.mode import Mode


class MakeMode(Mode):
    """Builds run beside the page."""

    label = "Make"
    hint = "Optimise the cords, and build the parts."

    def add_panel(self) -> None:
        bench = self.bench
        bench.button("Simulate the poses", "Up to the fields", lambda: bench.build("simulate"))
        bench.button("Optimise the cords", "Up to the layout", lambda: bench.build("optimize"))
        bench.button(
            "Take the optimised cords", "In place of those drawn; undo brings them back", self.take
        )
        bench.button("Build everything", "Parts, guide, report", lambda: bench.build("report"))
        bench.button("Cancel", "The last build stays", bench.builds.cancel)

    def take(self) -> None:
        """Write the optimised cords in place of those that are drawn."""
        folder = build_folder(self.bench.project.device)
        if not (folder / LAYOUT).exists():
            self.bench.say("Optimise the cords first.")
            return
        sensors = [record.sensor() for record in load_layout(folder).by_channel()]
        self.bench.do(take_cords(sensors))
