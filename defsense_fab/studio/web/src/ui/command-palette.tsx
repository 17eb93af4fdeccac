// The list of commands that is searched by typing, and the list of keys.
import { signal, useSignal } from "@preact/signals";
import { useId } from "preact/hooks";
import { type Command, commands, isAvailable, reasonAgainst, runAnywhere } from "../commands";
import { Dialog } from "./dialog";
import { KEY_NOTES, type KeyNote } from "./key-notes";
import { Icon } from "./icons";
import { Keys } from "./tooltip";

export const isPaletteOpen = signal(false);
export const isKeyHelpOpen = signal(false);

/** Heading of keys that mean the same for items of several kinds. */
const SHARED_GROUP = "Selection";
/** The order of the groups; others are in between, those of the page last. */
const FIRST_GROUPS = ["Edit", SHARED_GROUP];
const LAST_GROUPS = ["Steps", "View", "Help"];

/** How well a command fits a query: lower is better, null for not at all. */
function fit({ label, group }: Command, query: string): number | null {
  const text = `${label} ${group}`.toLowerCase();
  const whole = text.indexOf(query);
  if (whole >= 0) return whole;
  let at = -1;
  for (const letter of query.replaceAll(" ", "")) {
    at = text.indexOf(letter, at + 1);
    if (at < 0) return null;
  }
  return 1000 + at;
}

interface Found {
  command: Command;
  /** Why it cannot run now; empty if it can. */
  reason: string;
}

/** The commands that fit, those that can run before others that fit as well. */
function search(query: string): Found[] {
  const words = query.trim().toLowerCase();
  return commands.value
    .map((command) => ({
      command,
      score: fit(command, words),
      reason: isAvailable(command) ? "" : reasonAgainst(command),
    }))
    .filter(({ score }) => score !== null)
    .sort(
      (a, b) => a.score! - b.score! || Number(a.reason !== "") - Number(b.reason !== ""),
    );
}

export function CommandPalette() {
  return isPaletteOpen.value ? <OpenPalette /> : null;
}

function OpenPalette() {
  const id = useId();
  const query = useSignal("");
  const index = useSignal(0);
  const found = search(query.value);
  const at = Math.min(index.value, found.length - 1);

  const close = () => (isPaletteOpen.value = false);
  const choose = (chosen: Found | undefined) => {
    if (!chosen || chosen.reason) return;
    close();
    setTimeout(() => runAnywhere(chosen.command)); // after the focus has returned
  };
  const move = (change: number) => {
    index.value = (at + change + found.length) % Math.max(1, found.length);
    document.getElementById(`${id}-${index.value}`)?.scrollIntoView({ block: "nearest" });
  };

  const onKeyDown = (event: KeyboardEvent) => {
    const keys: Record<string, () => void> = {
      ArrowDown: () => move(1),
      ArrowUp: () => move(-1),
      Enter: () => choose(found[at]),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]!();
  };

  return (
    <Dialog title="Commands" isTitleHidden closesOutside onClose={close}>
      <div class="palette">
        <div class="palette-search">
          <Icon name="search" />
          <input
            autofocus
            role="combobox"
            aria-label="Search commands"
            aria-expanded="true"
            aria-controls={`${id}-list`}
            aria-activedescendant={found.length > 0 ? `${id}-${at}` : undefined}
            placeholder="Search commands"
            autocomplete="off"
            spellcheck={false}
            onInput={(event) => {
              query.value = event.currentTarget.value;
              index.value = 0;
            }}
            onKeyDown={onKeyDown}
          />
          <kbd>Esc</kbd>
        </div>
        <div class="palette-list" id={`${id}-list`} role="listbox" aria-label="Commands">
          {found.map(({ command, reason }, k) => (
            <div
              key={command.id}
              id={`${id}-${k}`}
              role="option"
              aria-selected={k === at}
              aria-disabled={reason ? true : undefined}
              class="palette-row"
              onPointerMove={() => (index.value = k)}
              onClick={() => choose(found[k])}
            >
              <span class="palette-label">{command.label}</span>
              <span class="palette-group">{reason || command.group}</span>
              {command.shortcut && <Keys shortcut={command.shortcut} />}
            </div>
          ))}
        </div>
        {found.length === 0 && <p class="palette-empty">No command matches “{query.value}”.</p>}
      </div>
    </Dialog>
  );
}

/** All keys once; those of several kinds of items under a heading of their own. */
function keyRows(): KeyNote[] {
  const rows = new Map<string, KeyNote>();
  for (const { label, group, shortcut } of commands.value) {
    if (!shortcut) continue;
    const key = `${label} ${shortcut}`;
    rows.set(key, { label, shortcut, group: rows.has(key) ? SHARED_GROUP : group });
  }
  return [...rows.values(), ...KEY_NOTES];
}

function groupOrder(group: string): number {
  const [first, last] = [FIRST_GROUPS.indexOf(group), LAST_GROUPS.indexOf(group)];
  return first >= 0 ? first - FIRST_GROUPS.length : last + 1;
}

/** The list of keys, by group. */
export function KeyHelp() {
  if (!isKeyHelpOpen.value) return null;
  const rows = keyRows();
  const groups = [...new Set(rows.map(({ group }) => group))].sort(
    (a, b) => groupOrder(a) - groupOrder(b),
  );
  return (
    <Dialog
      title="Keyboard shortcuts"
      size="large"
      closesOutside
      isText
      onClose={() => (isKeyHelpOpen.value = false)}
    >
      <div class="key-groups">
        {groups.map((group) => (
          <table key={group} class="key-table">
            <caption>{group}</caption>
            <tbody>
              {rows
                .filter((row) => row.group === group)
                .map(({ label, shortcut }) => (
                  <tr key={label}>
                    <th scope="row">{label}</th>
                    <td>
                      <Keys shortcut={shortcut} />
                    </td>
                  </tr>
                ))}
            </tbody>
          </table>
        ))}
      </div>
    </Dialog>
  );
}
