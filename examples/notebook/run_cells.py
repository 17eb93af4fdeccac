"""Run the cells of a notebook in order and save their outputs: python run_cells.py FILE."""

import ast
import base64
import io
import json
import sys
from contextlib import redirect_stdout
from pathlib import Path


def display_data(value):
    """Return the outputs of a cell's last value, as a notebook stores them."""
    if value is None:
        return None
    data = {"text/plain": repr(value)}
    if hasattr(value, "savefig"):
        file = io.BytesIO()
        value.savefig(file, format="png", dpi=70)
        data["image/png"] = base64.b64encode(file.getvalue()).decode()
    elif hasattr(value, "_repr_png_"):
        data = {"image/png": base64.b64encode(value._repr_png_()).decode()}
    elif hasattr(value, "_repr_html_"):
        data["text/html"] = value._repr_html_()
    return data


def run(source, names):
    """Run a cell with the variables `names`; return its outputs."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if last else None
    outputs = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue()})
    if (data := display_data(value)) is not None:
        outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
    return outputs


def run_notebook(path):
    """Return the notebook with the outputs of its cells, and the variables afterwards."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    names = {"__name__": "notebook"}
    code = [c for c in notebook["cells"] if c["cell_type"] == "code"]
    for count, cell in enumerate(code, 1):
        cell["outputs"] = run("".join(cell["source"]), names)
        cell["execution_count"] = count
    return notebook, names


if __name__ == "__main__":
    file = Path(sys.argv[1])
    executed, _ = run_notebook(file)
    file.write_text(json.dumps(executed, indent=1) + "\n", encoding="utf-8")
