"""The ways to all screens of the studio, by accessible roles and names."""

from __future__ import annotations

import numpy as np

from tests.conftest import box_surface

STEPS = ("Body", "Poses", "Inside", "Sensors", "Optimize", "Make", "Measure")


def dismiss_introduction(page):
    """Decline the introduction, which a new browser offers."""
    page.get_by_role("dialog", name="Introduction").get_by_role("button", name="Not now").click()


def step_button(page, name):
    """Return the button of a step in the bar of steps."""
    return page.get_by_role("navigation", name="Steps").get_by_role("button", name=name)


def inspector(page, step):
    """Return the panel of the entered step."""
    return page.get_by_role("complementary", name=step, exact=True)


def _content(page, step):
    """Return what a step shows last when it is entered on a built device."""
    return {
        "Body": page.get_by_label("Edge length", exact=True),
        "Poses": page.get_by_role("slider", name="Turn tip about y"),
        "Inside": page.get_by_role("figure", name="Colors: Largest principal strain"),
        "Sensors": page.get_by_role("table", name="Expected error and signals of each pose"),
        "Optimize": page.get_by_role("table", name="Layouts; errors in mm"),
        "Make": page.get_by_role("button", name="Print the parts"),
        "Measure": page.get_by_role("article", name="Check the board"),
    }[step]


def enter(page, step):
    """Enter a step of a built device, and wait until its content is shown."""
    step_button(page, step).click()
    _content(page, step).wait_for()


def open_live_view(page):
    """Start the live view of the simulated twin; the device needs a model."""
    enter(page, "Measure")
    outline = page.get_by_role("navigation", name="Work with the finished device")
    outline.get_by_role("button", name="Live").click()
    page.get_by_role("article", name="Live").get_by_role("button", name="Start").click()
    page.get_by_role("dialog", name="Live").get_by_text("Controls", exact=True).wait_for()


def write_stl(path):
    """Write a box as an STL file."""
    surface = box_surface([0, 0, 0], [120, 30, 25])
    corners = surface.vertices[surface.faces].astype("<f4")
    facets = np.zeros(len(corners), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    facets["v"] = corners
    path.write_bytes(bytes(80) + np.uint32(len(corners)).tobytes() + facets.tobytes())
    return path


def upload(page, path):
    """Upload a body on the start page, and wait for its form."""
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose a file").click()
    chooser.value.set_files(path)
    page.get_by_role("button", name="Create the device").wait_for()
