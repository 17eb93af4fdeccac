// The material, cord and printer of the device, with their key numbers.
import { signal } from "@preact/signals";
import type { Catalogue, CatalogueChoice } from "../../protocol/messages";
import { Icon } from "../../ui/icons";
import { formatNumber } from "../../ui/number";
import { Section } from "../../ui/section";
import { CatalogueDialog } from "./catalogue-dialog";
import { catalogues, deviceFields } from "./events";

export type Cell = number | string | null;

const TITLES: Record<Catalogue["name"], string> = {
  material: "Material",
  cord: "Cord",
  trace: "Trace",
  printer: "Printer",
};
const SHOWN_COLUMNS = 3;

/** The list that is open to choose from. */
export const openedCatalogue = signal<Catalogue["name"] | null>(null);

/** Buttons that show what is chosen, and open the list to choose from. */
export function CatalogueChoices() {
  const choices = deviceFields.value?.choices ?? [];
  const find = (name: Catalogue["name"] | null) =>
    catalogues.value?.catalogues.find((catalogue) => catalogue.name === name);
  const catalogue = find(openedCatalogue.value);
  const chosen = choices.find((choice) => choice.catalogue === openedCatalogue.value);
  return (
    <Section title="Materials" name="body.materials">
      {choices.map((choice) => (
        <ChoiceButton
          key={choice.catalogue}
          choice={choice}
          catalogue={find(choice.catalogue)}
          onClick={() => (openedCatalogue.value = choice.catalogue)}
        />
      ))}
      {catalogue && chosen && (
        <CatalogueDialog
          title={TITLES[catalogue.name]}
          catalogue={catalogue}
          choice={chosen}
          onClose={() => (openedCatalogue.value = null)}
        />
      )}
    </Section>
  );
}

interface ChoiceButtonProps {
  choice: CatalogueChoice;
  catalogue: Catalogue | undefined;
  onClick: () => void;
}

function ChoiceButton({ choice, catalogue, onClick }: ChoiceButtonProps) {
  const { name, values, isCustom, changed } = choice;
  const columns = catalogue?.columns ?? [];
  const numbers = columns
    .map(({ label, unit }, k) => ({ label, text: cellText(values[k] ?? null, unit) }))
    .filter(({ text }) => text !== "")
    .slice(0, SHOWN_COLUMNS);
  return (
    <button type="button" class="choice-button" aria-haspopup="dialog" onClick={onClick}>
      <span class="choice-head">
        <span class="choice-title">{TITLES[choice.catalogue]}</span>
        <strong>{name}</strong>
        {isCustom && <span class="chip">custom</span>}
        <Icon name="chevronRight" size={14} />
      </span>
      <span class="choice-numbers">
        {numbers.map(({ label, text }) => (
          <span key={label} class={changed.includes(label) ? "changed" : ""}>
            <small>{label}</small>
            {text}
          </span>
        ))}
      </span>
    </button>
  );
}

/** A cell of a catalogue as text, with its unit. */
export function cellText(value: Cell, unit: string): string {
  if (value === null) return "";
  const text = typeof value === "number" ? formatNumber(value, 4) : value;
  return unit ? `${text} ${unit}` : text;
}
