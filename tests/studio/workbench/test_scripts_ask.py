"""Every place of the studio that makes a body asks the workbench first."""

from __future__ import annotations

import ast

from tests.support.places import ROOT

#: Functions that run a body's script, with the modules that export them.
RUNS = {
    ("workflow.build.build", "build"),
    ("workflow.build.build", "build_body"),
    ("workflow.build.freshness", "build_body"),
    ("workflow.study.propose_poses", "find_poses"),
    ("workflow.study.propose_poses", "propose_poses"),
    ("workflow.study.cord_count", "study_cord_count"),
    ("geometry.bodies.body", "load_body"),
    ("workflow.tags.markers", "write_markers"),
}
#: Modules whose callers ask through `Workbench.build` or `Workbench.may_run_script`.
ASK = {"workbench/build_job.py", "device/body_preview.py", "poses/suggestion_part.py"}


def test_no_other_module_of_the_studio_runs_a_script():
    studio = ROOT / "defsense_fab" / "studio"
    runners = set()
    for path in studio.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names = {(node.module or "", alias.name) for alias in node.names}
                if names & RUNS:
                    runners.add(path.relative_to(studio).as_posix())
    assert runners == ASK
