// The list of materials, cords or printers, searched by typing, with their numbers side by side.
import { useSignal } from "@preact/signals";
import { useEffect, useId } from "preact/hooks";
import type { Catalogue, CatalogueChoice, Problem } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { attempt } from "../../state/run";
import { Dialog } from "../../ui/dialog";
import { Icon } from "../../ui/icons";
import { type Cell, cellText } from "./catalogue-choices";

type Row = Catalogue["rows"][number];

interface CatalogueDialogProps {
  title: string;
  catalogue: Catalogue;
  choice: CatalogueChoice;
  onClose: () => void;
}

/** A dialog with all rows; arrow keys move in it, Enter and a click choose. */
export function CatalogueDialog({ title, catalogue, choice, onClose }: CatalogueDialogProps) {
  const id = useId();
  const query = useSignal("");
  /** Column by which the rows are sorted; -1 for the order of the catalogue. */
  const sorted = useSignal(-1);
  const rows = sortRows(searchRows(catalogue.rows, query.value), sorted.value);
  const chosenName = useSignal(choice.name);
  const problem = useSignal<Problem | null>(null);
  const at = Math.max(0, rows.findIndex((row) => row.name === chosenName.value));
  const row = rows[at];

  useEffect(() => {
    document.getElementById(`${id}-${at}`)?.scrollIntoView({ block: "nearest" });
  }, [at]);

  const choose = async (chosen: Row | undefined) => {
    if (!chosen) return;
    chosenName.value = chosen.name;
    const content = { catalogue: catalogue.name, name: chosen.name };
    const done = await attempt(connection.send("choose-row", content), (refused) => {
      problem.value = refused;
    });
    if (done !== undefined) onClose();
  };
  const move = (change: number) => {
    const next = rows[Math.min(rows.length - 1, Math.max(0, at + change))];
    if (next) chosenName.value = next.name;
    problem.value = null;
  };
  const onKeyDown = (event: KeyboardEvent) => {
    const keys: Record<string, () => void> = {
      ArrowDown: () => move(1),
      ArrowUp: () => move(-1),
      PageDown: () => move(8),
      PageUp: () => move(-8),
      Enter: () => void choose(row),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]!();
  };

  return (
    <Dialog title={`Choose the ${title.toLowerCase()}`} size="large" onClose={onClose}>
      <label class="catalogue-search">
        <Icon name="search" />
        <input
          autofocus
          class="input"
          role="combobox"
          aria-label={`Search ${title.toLowerCase()}s`}
          aria-expanded="true"
          aria-controls={`${id}-list`}
          aria-activedescendant={row ? `${id}-${at}` : undefined}
          placeholder={`Search ${catalogue.rows.length} ${title.toLowerCase()}s by name or number`}
          autocomplete="off"
          spellcheck={false}
          onInput={(event) => (query.value = event.currentTarget.value)}
          onKeyDown={onKeyDown}
        />
      </label>
      {problem.value && (
        <p class="field-error" role="alert">
          <Icon name="error" size={14} /> <span>{problem.value.message}</span>
        </p>
      )}
      <div class="catalogue-list" style={{ "--columns": catalogue.columns.length }}>
        <div class="catalogue-row header">
          <SortButton label="Name" index={-1} sorted={sorted} />
          {catalogue.columns.map((column, k) => (
            <SortButton key={column.label} label={column.label} unit={column.unit} index={k} sorted={sorted} />
          ))}
        </div>
        <div id={`${id}-list`} role="listbox" aria-label={`${title}s`}>
          {rows.map((other, k) => (
            <div
              key={other.name}
              id={`${id}-${k}`}
              role="option"
              aria-selected={k === at}
              class="catalogue-row"
              onPointerDown={(event) => event.preventDefault()}
              onClick={() => void choose(other)}
            >
              <span class="catalogue-name">
                {other.name}
                {other.name === choice.name && <Icon name="check" size={14} />}
              </span>
              {catalogue.columns.map((column, c) => (
                <span key={column.label} class="catalogue-cell">
                  <span class="visually-hidden">{column.label} </span>
                  {cellText(other.values[c] ?? null, "") || "–"}
                  <span class="visually-hidden"> {column.unit}</span>
                </span>
              ))}
            </div>
          ))}
        </div>
        {rows.length === 0 && <p class="palette-empty">Nothing matches “{query.value}”.</p>}
      </div>
      {row && (
        <p class="catalogue-source" aria-live="polite" tabIndex={0}>
          <strong>{row.name}</strong>
          {row.note && `, ${row.note}`}. {row.source}
        </p>
      )}
    </Dialog>
  );
}

interface SortButtonProps {
  label: string;
  unit?: string;
  index: number;
  sorted: { value: number };
}

function SortButton({ label, unit = "", index, sorted }: SortButtonProps) {
  const isSorted = sorted.value === index;
  return (
    <button
      type="button"
      class={`sort-button ${index < 0 ? "" : "number"}`}
      aria-pressed={isSorted}
      aria-label={`Sort by ${label.toLowerCase()}`}
      onClick={() => (sorted.value = index)}
    >
      <span>
        {label}
        {unit && <small>{unit}</small>}
      </span>
      {isSorted && index >= 0 && <Icon name="chevronDown" size={12} />}
    </button>
  );
}

function searchRows(rows: readonly Row[], query: string): readonly Row[] {
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  return rows.filter((row) => {
    const text = [row.name, row.note, ...row.values].join(" ").toLowerCase();
    return words.every((word) => text.includes(word));
  });
}

/** The rows in the order of a column, those without a value last. */
function sortRows(rows: readonly Row[], column: number): readonly Row[] {
  if (column < 0) return rows;
  return [...rows].sort((a, b) => compare(a.values[column] ?? null, b.values[column] ?? null));
}

function compare(a: Cell, b: Cell): number {
  if (a === null || b === null) return Number(a === null) - Number(b === null);
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a).localeCompare(String(b), undefined, { numeric: true });
}
