"""Pages of the guide that come from the declarations of the files that users edit.

A page shows the keys of a file where it says ```{file-keys} device```. The JSON Schema of each file
is written to `schemas/` next to the pages.
"""

import json
from pathlib import Path

from sphinx.util.docutils import SphinxDirective

from defsense_fab.core.device.device_file import DeviceFile
from defsense_fab.core.schema.reference import json_schema, markdown
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

    required_arguments = 1

    def run(self):
        """Return the tables as nodes; Sphinx calls this."""
        kind = FILES[self.arguments[0]]
        for module in Path(__file__).parents[1].glob("defsense_fab/core/schema/*.py"):
            self.env.note_dependency(str(module))
        text = [markdown(kind)]
        self.env.events.emit("source-read", self.env.docname, text)  # links, as in pages
        return self.parse_text_to_nodes(text[0], allow_section_headings=True)


def write_schemas(app, error):
    """Write the JSON Schemas; Sphinx calls this after a build."""
    if error is None and app.builder.format == "html":
        folder = Path(app.outdir) / "schemas"
        folder.mkdir(exist_ok=True)
        for name, kind in FILES.items():
            text = json.dumps(json_schema(kind), indent=1, ensure_ascii=False)
            (folder / f"{name}.schema.json").write_text(text, encoding="utf-8")
