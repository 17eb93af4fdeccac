"""Parts of the guide that come from declared files and from tables in the package.

A page shows the keys of a file where it has ```{file-keys} device```, and the materials of each
process where it has ```{materials-of-processes}```, and the glues where it has ```{glues}```. The
JSON Schema of each file is written to `schemas/` next to the pages.
"""

import json
from pathlib import Path

from sphinx.util.docutils import SphinxDirective

from defsense_fab.core.device.device_file import DeviceFile
from defsense_fab.core.device.materials import list_materials
from defsense_fab.core.progress import describe_duration
from defsense_fab.core.schema.reference import json_schema, markdown
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.runtime.outputs.live_file import LiveFile
from defsense_fab.workflow.reproduce.experiment import ExperimentFile
from defsense_fab.workflow.study.study_file import StudyFile

FILES = {
    "device": DeviceFile,
    "live": LiveFile,
    "study": StudyFile,
    "experiment": ExperimentFile,
}


class FileKeys(SphinxDirective):
    """The reference of a file, by its name without `.toml`, in place of the directive."""

    has_content = True  # shown where the Markdown is read without the site
    required_arguments = 1

    def run(self):
        """Return the tables as nodes; Sphinx calls this."""
        kind = FILES[self.arguments[0]]
        for module in Path(__file__).parents[1].glob("defsense_fab/core/schema/*.py"):
            self.env.note_dependency(str(module))
        text = [markdown(kind)]
        self.env.events.emit("source-read", self.env.docname, text)  # links, as in pages
        return self.parse_text_to_nodes(text[0], allow_section_headings=True)


class MaterialsOfProcesses(SphinxDirective):
    """A table of the processes with the materials that each makes, in place of the directive."""

    has_content = True  # shown where the Markdown is read without the site

    def run(self):
        """Return the table as nodes; Sphinx calls this."""
        lines = ["| process | materials |", "|---|---|"]
        for process in read_rows("printers.csv"):
            materials = ", ".join(f"`{name}`" for name in list_materials(process))
            lines.append(f"| `{process}` | {materials} |")
        return self.parse_text_to_nodes("\n".join(lines))


class Glues(SphinxDirective):
    """A table of the kinds of glue with the materials that each joins, where a page has `glues`."""

    has_content = True  # shown where the Markdown is read without the site

    def run(self):
        """Return the table as nodes; Sphinx calls this."""
        lines = [
            "| glue | example | close within | press for | full strength | materials |",
            "|---|---|---|---|---|---|",
        ]
        for name, glue in read_rows("glues.csv").items():
            times = [
                describe_duration(seconds)
                for seconds in (
                    60 * float(glue["open_minutes"]),
                    3600 * float(glue["press_hours"]),
                    3600 * float(glue["cure_hours"]),
                )
            ]
            rows = read_rows("materials.csv").items()
            materials = ", ".join(f"`{n}`" for n, row in rows if row["glue"] == name)
            cells = [glue["kind"], glue["example"], *times, materials or "bonded cords"]
            lines.append(f"| {' | '.join(cells)} |")
        tables = self.parse_text_to_nodes("\n".join(lines))
        for table in tables:
            table["classes"].append("wide-last")
        return tables


def write_schemas(app, error):
    """Write the JSON Schemas; Sphinx calls this after a build."""
    if error is None and app.builder.format == "html":
        folder = Path(app.outdir) / "schemas"
        folder.mkdir(exist_ok=True)
        for name, kind in FILES.items():
            text = json.dumps(json_schema(kind), indent=1, ensure_ascii=False)
            (folder / f"{name}.schema.json").write_text(text, encoding="utf-8")
