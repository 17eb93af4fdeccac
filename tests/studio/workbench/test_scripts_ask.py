"""Where in the studio bodies are made: each of these places asks the workbench first."""

from __future__ import annotations

import ast

from tests.support.places import ROOT

#: What runs a body's script, by the module that it is imported from.
RUNS = {
    ("workflow.build.build", "build"),
    ("workflow.build.freshness", "build_body"),
    ("workflow.study.propose_poses", "find_poses"),
    ("workflow.study.propose_poses", "propose_poses"),
    ("workflow.study.cord_count", "study"),
    ("geometry.bodies.body", "load_body"),
    ("workflow.tags.markers", "write_markers"),
}
#: Behind `Workbench.build`, and behind `Workbench.may_run`.
ASK = {"workbench/build_work.py", "device/body_preview.py", "poses/suggestion_part.py"}


def test_no_other_module_of_the_studio_can_run_a_script():
    studio = ROOT / "defsense_fab" / "studio"
    found = set()
    for path in studio.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names = {(node.module or "", alias.name) for alias in node.names}
                if names & RUNS:
                    found.add(path.relative_to(studio).as_posix())
    assert found == ASK
