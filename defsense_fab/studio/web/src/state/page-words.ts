// Texts of the library, which name keys of device.toml, in the words of the page's labels.
import type { DeviceField, Problem } from "../protocol/messages";

const TABLES = "body|material|mesh|cord|design|fabrication|readout|states|outputs|wires";
const DOTTED_KEY = new RegExp(`(?<![./\\w])(${TABLES})\\.([a-z][a-z_]*)\\b(?!\\.)`, "g");
const TABLE_KEY = new RegExp(
  `\\[(${TABLES})\\] (?!(?:in|of|to|is)\\b)([a-z][a-z_]*)((?: \\([^)]*\\)| = [^ ,;:]+)?(?:,? (?:and|or) ([a-z][a-z_]*)\\b)?)`,
  "g",
);
const ASSIGNMENT = new RegExp(
  `\\b(?:[Ss]et|[Ww]rite) ([a-z][a-z_]*) = (\\S+) (?:in|under) \\[(${TABLES})\\]`,
  "g",
);
const TABLE = new RegExp(`\\[(${TABLES})\\]`, "g");

const REGION_PLACE = /device\.toml(:\d+)?: regions\./;

/** Keys that the page shows in another way than as a field. */
const OTHER_LABELS: Record<string, string> = {
  "cord.length": "Length of a cord",
  "cord.process": "Process of the cords",
  "fabrication.bed": "Print bed",
  "fabrication.keep_whole": "Regions kept whole",
  "outputs.markers": "Number of markers",
  "states.ramp": "Levels of the poses",
  "wires.exit": "Exits of the cords",
};
const TABLE_TITLES: Record<string, string> = {
  body: "Body file",
  cord: "Cord values",
  material: "Material values",
};
const VALUES: Record<string, string> = { true: "Yes", false: "No" };

let fields: ReadonlyMap<string, string> = new Map();

/** Take the labels of the page's fields. */
export function nameFields(shown: readonly DeviceField[]): void {
  fields = new Map(shown.map(({ key, label }) => [key, label]));
}

/** The first key in a text that has a field on the page, or null. */
export function findField(text: string): { key: string; label: string } | null {
  const quoted = [...text.matchAll(/“([^”]+)”/g)].map(([, label]) => label);
  const found = [...fields].find(([, label]) => quoted.includes(label));
  return found ? { key: found[0], label: found[1] } : null;
}

export const fieldLabel = (key: string): string | null => fields.get(key) ?? null;

function labelOf(table: string, name: string): string {
  const key = `${table}.${name}`;
  const words = name.replaceAll("_", " ");
  return `“${fields.get(key) ?? OTHER_LABELS[key] ?? capitalized(words)}”`;
}

const isKey = (table: string, name: string): boolean =>
  name.includes("_") || fields.has(`${table}.${name}`) || `${table}.${name}` in OTHER_LABELS;

/** A text with the page's labels in place of keys of device.toml. */
export function inPageWords(text: string): string {
  if (!/\[|\.toml|\w_\w|\w\.\w/.test(text)) return text;
  const translated = text
    .replace(/`([^`]*)`/g, (whole, code: string) => (/[[.=]/.test(code) ? code : whole))
    .replace(ASSIGNMENT, (_, name: string, value: string, table: string) => {
      const word = VALUES[value] ?? value.replace(/^"(.*)"$/, "$1");
      return `Set ${labelOf(table, name)} to ${word}`;
    })
    .replace(TABLE_KEY, (_, table: string, name: string, rest: string, other?: string) => {
      const label = labelOf(table, name);
      if (!other || !isKey(table, other)) return `${label}${rest}`;
      return `${label}${rest.slice(0, -other.length)}${labelOf(table, other)}`;
    })
    .replace(DOTTED_KEY, (whole, table: string, name: string) =>
      isKey(table, name) ? labelOf(table, name) : whole,
    )
    .replace(/\b(as|in|under) \[\[sensors\]\]/g, "in Sensors")
    .replace(/\b(as|in|under) \[\[poses\]\]/g, "in Poses")
    .replaceAll("[[sensors]]", "cords")
    .replaceAll("[[poses]]", "poses")
    .replace(TABLE, (_, table: string) => `“${TABLE_TITLES[table] ?? capitalized(table)}”`)
    .replace(/\b(under|in) (“[^”]+”) in device\.toml/g, "$1 $2")
    .replaceAll("control_points", "control points")
    .replaceAll("held_out", "held-out states");
  if (translated === text && !REGION_PLACE.test(text)) return text;
  return capitalized(
    translated
      .replace(/ in device\.toml\b/g, "")
      .replace(/^[^“]*?device\.toml(:\d+)?: (sensors: |poses: |regions\.[^:]+: )?/, ""),
  );
}

const FORMULA = /(?<![\w.*+])\d*\.?\d+\*[^\s+*:]+(?:\+\d*\.?\d+\*[^\s+*:]+)*/g;

/** A text in which mixed states such as "1*twist+0.5*bend" are in words: "twist + 50 % bend". */
export function stateWords(text: string): string {
  return text.replace(FORMULA, (formula) =>
    formula
      .split("+")
      .map((term) => {
        const [weight, pose] = term.split("*");
        const percent = Math.round(100 * Number(weight));
        return percent === 100 ? pose : `${percent} % ${pose}`;
      })
      .join(" + "),
  );
}

const capitalized = (word: string): string => `${word[0]!.toUpperCase()}${word.slice(1)}`;

function isProblem(value: unknown): value is Problem {
  return value !== null && typeof value === "object" && "code" in value && "text" in value && "field" in value;
}

/**
 * A reviver for messages of the server that translates their problems. The problem of a page that
 * cannot be read is kept: it is fixed in the file.
 */
export function readProblems(this: unknown, _: string, value: unknown): unknown {
  if (!isProblem(value)) return value;
  if ((this as { kind?: string }).kind === "page") return value;
  return { ...value, text: inPageWords(value.text), message: inPageWords(value.message) };
}
