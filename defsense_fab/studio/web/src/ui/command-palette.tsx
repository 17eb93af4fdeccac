// The list of commands that is searched by typing, and the list of keys.
import { signal, useSignal } from "@preact/signals";
import { useId } from "preact/hooks";
import { type Command, commands, isAvailable } from "../commands";
import { Dialog } from "./dialog";
import { Icon } from "./icons";
import { Keys } from "./tooltip";

export const isPaletteOpen = signal(false);
export const isKeyHelpOpen = signal(false);

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

function search(query: string): Command[] {
  const available = commands.value.filter(isAvailable);
  const words = query.trim().toLowerCase();
  return available
    .map((command) => ({ command, score: fit(command, words) }))
    .filter(({ score }) => score !== null)
    .sort((a, b) => a.score! - b.score!)
    .map(({ command }) => command);
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
  const choose = (command: Command | undefined) => {
    if (!command) return;
    close();
    setTimeout(command.run); // after the focus has returned
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
          {found.map((command, k) => (
            <div
              key={command.id}
              id={`${id}-${k}`}
              role="option"
              aria-selected={k === at}
              class="palette-row"
              onPointerMove={() => (index.value = k)}
              onClick={() => choose(command)}
            >
              <span class="palette-label">{command.label}</span>
              <span class="palette-group">{command.group}</span>
              {command.shortcut && <Keys shortcut={command.shortcut} />}
            </div>
          ))}
        </div>
        {found.length === 0 && <p class="palette-empty">No command matches “{query.value}”.</p>}
      </div>
    </Dialog>
  );
}

/** The list of keys, by group. */
export function KeyHelp() {
  if (!isKeyHelpOpen.value) return null;
  const withKeys = commands.value.filter(({ shortcut }) => shortcut);
  const groups = [...new Set(withKeys.map(({ group }) => group))].sort(
    (a, b) => LAST_GROUPS.indexOf(a) - LAST_GROUPS.indexOf(b),
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
              {withKeys
                .filter((command) => command.group === group)
                .map(({ id, label, shortcut }) => (
                  <tr key={id}>
                    <th scope="row">{label}</th>
                    <td>
                      <Keys shortcut={shortcut!} />
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
