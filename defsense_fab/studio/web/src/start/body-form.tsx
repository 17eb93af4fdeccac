// The form for an uploaded body: its unit and size, and the device that is made from it.
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Problem, UploadedBody } from "../protocol/messages";
import { connection } from "../state/connection";
import { attempt } from "../state/run";
import { Button } from "../ui/button";
import { Icon } from "../ui/icons";
import { formatNumber } from "../ui/number";
import { NumberField } from "../ui/number-field";
import { SelectField } from "../ui/select-field";
import { TextField } from "../ui/text-field";
import { BodyPreview } from "./body-preview";
import { newFolder } from "./recent-devices";
import { gallery, leaveUpload, uploadedBody } from "./upload";

/** Choice of the unit for a file whose longest side is given instead. */
const UNKNOWN_UNIT = "unknown";
const UNIT_LABELS: Record<string, string> = {
  mm: "millimeters",
  cm: "centimeters",
  m: "meters",
  inch: "inches",
  um: "micrometers",
};
const MM3_PER_CM3 = 1000;

/** A form next to the body in 3D. */
export function BodyForm({ body }: { body: UploadedBody }) {
  const name = useSignal(body.name);
  const { materials = [], defaultMaterial = "" } = gallery.value ?? {};
  const material = useSignal(defaultMaterial);
  const edge = useSignal<number | null>(null);
  const problem = useSignal<Problem | null>(null);
  const isBusy = useSignal(false);
  const edgeLength = edge.value ?? body.edgeLength;

  useEffect(() => {
    edge.value = null; // the default follows the size
  }, [body.scale]);

  const create = async () => {
    isBusy.value = true;
    problem.value = null;
    const content = {
      name: name.value,
      unit: body.unit || null,
      size: body.unit ? null : longest(body),
      material: material.value,
      edgeLength,
    };
    const created = await attempt(connection.send("create-from-body", content), (refused) => {
      problem.value = refused;
    });
    isBusy.value = false;
    if (created !== undefined) leaveUpload();
  };

  return (
    <div class="body-form-page">
      <BodyPreview scale={body.scale} />
      <main class="body-form" aria-labelledby="body-form-title">
        <header>
          <Button variant="quiet" icon="arrowLeft" onClick={leaveUpload}>
            All devices
          </Button>
          <h1 id="body-form-title">New device from {body.name + body.format}</h1>
        </header>
        <SizeSummary body={body} />
        {!body.hasUnit && <UnitFields body={body} />}
        <TextField label="Name" value={name.value} onCommit={(text) => void (name.value = text)} layout="stack" />
        <SelectField
          label="Material"
          layout="stack"
          value={material.value}
          choices={materials.map((row) => ({
            value: row.name,
            label: `${row.name}, ${formatNumber(row.youngModulus, 3)} MPa`,
          }))}
          help="Young's modulus at small strain. You can change it later."
          onCommit={(chosen) => void (material.value = chosen)}
        />
        <NumberField
          key={body.scale}
          label="Edge length of the mesh"
          layout="stack"
          unit="mm"
          step={0.1}
          value={edgeLength}
          min={roundUp(body.minEdgeLength)}
          max={body.maxEdgeLength}
          help={`About a fifth of the thickness; at most ${formatNumber(body.maxEdgeLength, 4)} mm.`}
          onCommit={(length) => void (edge.value = length)}
        />
        <p class="field-help">One end of the body is held and the other is moved. You can change this later.</p>
        {problem.value && (
          <p class="field-error" role="alert">
            <Icon name="error" size={14} /> <span>{problem.value.text}</span>
          </p>
        )}
        <footer>
          <p class="field-help">{newFolder(name.value)}</p>
          <Button variant="primary" isBusy={isBusy.value} onClick={() => void create()}>
            Create the device
          </Button>
        </footer>
      </main>
    </div>
  );
}

function SizeSummary({ body }: { body: UploadedBody }) {
  const notes = [...(body.warning ? [body.warning] : [])];
  return (
    <section class="size-summary" aria-label="Size">
      <strong>{body.size.map((x) => formatNumber(x, 4)).join(" × ")} mm</strong>
      <span>{formatNumber(body.volume / MM3_PER_CM3, 3)} cm³</span>
      {body.isDoubtful && (
        <p class="note warning" role="status">
          <Icon name="warning" />
          <span>
            The file does not state its unit. <b>{UNIT_LABELS[body.unit] ?? body.unit}</b> is a guess from the
            size: check it.
          </span>
        </p>
      )}
      {notes.map((note) => (
        <p key={note} class="note warning">
          <Icon name="warning" />
          <span>{note}.</span>
        </p>
      ))}
      {body.repairs.length > 0 && (
        <p class="note">
          <Icon name="info" />
          <span>Repaired: {body.repairs.join(", ")}.</span>
        </p>
      )}
    </section>
  );
}

/** The unit of a mesh, or the length of its longest side. */
function UnitFields({ body }: { body: UploadedBody }) {
  const describe = async (unit: string | null, size: number | null) => {
    uploadedBody.value = await connection.send("describe-upload", { unit, size });
  };
  const choices = (gallery.value?.units ?? []).map((unit) => ({
    value: unit,
    label: UNIT_LABELS[unit] ?? unit,
  }));
  return (
    <>
      <SelectField
        label="Unit of the file"
        layout="stack"
        value={body.unit || UNKNOWN_UNIT}
        choices={[...choices, { value: UNKNOWN_UNIT, label: "unknown: set the longest side" }]}
        onCommit={(unit) =>
          unit === UNKNOWN_UNIT ? describe(null, longest(body)) : describe(unit, null)
        }
      />
      <NumberField
        label="Longest side"
        layout="stack"
        unit="mm"
        min={1}
        max={10_000}
        value={longest(body)}
        onCommit={(size) => describe(null, size)}
      />
    </>
  );
}

function longest(body: UploadedBody): number {
  return Number(Math.max(...body.size).toPrecision(6));
}

function roundUp(value: number): number {
  const unit = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Math.ceil(value / unit) * unit;
}
