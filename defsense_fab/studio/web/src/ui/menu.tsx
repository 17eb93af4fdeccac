// Menus: those of buttons, and context menus at the pointer.
import { signal } from "@preact/signals";
import * as zagMenu from "@zag-js/menu";
import { normalizeProps, useMachine } from "@zag-js/preact";
import type { ComponentChildren } from "preact";
import { useId, useLayoutEffect, useRef } from "preact/hooks";
import { type Command, findCommand, isAvailable } from "../commands";
import { Icon, type IconName } from "./icons";
import { Keys, tooltip } from "./tooltip";

export interface MenuAction {
  id: string;
  label: string;
  icon?: IconName;
  shortcut?: string;
  isDanger?: boolean;
  disabled?: boolean;
  /** For one of several values: whether it is the chosen one. */
  isChecked?: boolean;
  run: () => void;
}

export type MenuEntry = MenuAction | { heading: string } | "separator";

/** The entry of a registered command. */
export function commandEntry(id: string, icon?: IconName, isDanger = false): MenuEntry[] {
  const command: Command | undefined = findCommand(id);
  if (!command) return [];
  const { label, shortcut, run } = command;
  return [{ id, label, icon, isDanger, shortcut, disabled: !isAvailable(command), run }];
}

type Api = zagMenu.Api;

function isAction(entry: MenuEntry): entry is MenuAction {
  return typeof entry === "object" && "id" in entry;
}

function select(entries: readonly MenuEntry[], id: string): void {
  entries.find((entry): entry is MenuAction => isAction(entry) && entry.id === id)?.run();
}

interface MenuButtonProps {
  label: string;
  icon?: IconName;
  /** Text of the button; without it, it is an icon. */
  children?: ComponentChildren;
  entries: () => readonly MenuEntry[];
}

/** A button that opens a menu. */
export function MenuButton({ label, icon = "more", children, entries }: MenuButtonProps) {
  const service = useMachine(zagMenu.machine, {
    id: useId(),
    "aria-label": label,
    positioning: { placement: "bottom-end", strategy: "fixed", gutter: 6 },
    // Once the menu has given the focus back, as the action may move it.
    onSelect: ({ value }) => setTimeout(() => select(entries(), value)),
  });
  const api = zagMenu.connect(service, normalizeProps);
  return (
    <>
      <button
        {...api.getTriggerProps()}
        class={children ? "button plain" : "icon-button"}
        aria-label={children ? undefined : label}
        {...tooltip(api.open ? undefined : label)}
      >
        <Icon name={icon} />
        {children}
      </button>
      {api.open && <MenuContent api={api} label={label} entries={entries()} />}
    </>
  );
}

interface OpenMenu {
  point: { x: number; y: number };
  /** Whether it was opened by a key, so that the first entry is highlighted. */
  isByKey: boolean;
  label: string;
  entries: readonly MenuEntry[];
}

const openMenu = signal<OpenMenu | null>(null);

/** Open a menu at a point of the window. */
export function openContextMenu(
  point: OpenMenu["point"],
  label: string,
  entries: readonly MenuEntry[],
  isByKey = false,
): void {
  openMenu.value = entries.length > 0 ? { point, isByKey, label, entries } : null;
}

/** Open a menu at the place of an event: at the pointer, or below the element for a key. */
export function openContextMenuFor(
  event: MouseEvent,
  label: string,
  entries: readonly MenuEntry[],
): void {
  event.preventDefault();
  event.stopPropagation();
  const { left, bottom } = (event.currentTarget as Element).getBoundingClientRect();
  const isByKey = !isByPointer(event);
  const point = isByKey ? { x: left, y: bottom } : { x: event.clientX, y: event.clientY };
  openContextMenu(point, label, entries, isByKey);
}

/** Whether a press of the mouse or a long touch opens a menu; Ctrl and a click do so on a Mac. */
function isByPointer(event: MouseEvent): boolean {
  const isTouch = event instanceof PointerEvent && ["touch", "pen"].includes(event.pointerType);
  return isTouch || event.button === 2 || event.ctrlKey;
}

/** The layer that shows the menu at a point. */
export function ContextMenuLayer() {
  const menu = openMenu.value;
  return menu && <PointMenu key={`${menu.point.x},${menu.point.y},${menu.label}`} {...menu} />;
}

function PointMenu({ point, isByKey, label, entries }: OpenMenu) {
  const focused = useRef(document.activeElement);
  const service = useMachine(zagMenu.machine, {
    id: useId(),
    "aria-label": label,
    open: true,
    defaultHighlightedValue: isByKey ? (entries.find(isAction)?.id ?? null) : null,
    anchorPoint: point,
    positioning: {
      placement: "bottom-start",
      strategy: "fixed",
      gutter: 2,
      getAnchorRect: () => ({ ...point, width: 0, height: 0 }),
    },
    onSelect: ({ value }) => {
      close();
      select(entries, value);
    },
    onOpenChange: ({ open }) => {
      if (!open) close();
    },
  });
  const close = () => {
    openMenu.value = null;
    if (focused.current instanceof HTMLElement) focused.current.focus();
  };
  const api = zagMenu.connect(service, normalizeProps);
  return <MenuContent api={api} label={label} entries={entries} />;
}

interface MenuContentProps {
  api: Api;
  label: string;
  entries: readonly MenuEntry[];
}

function MenuContent({ api, label, entries }: MenuContentProps) {
  const layer = useRef<HTMLDivElement>(null);
  useLayoutEffect(() => layer.current?.showPopover(), []);
  return (
    <div ref={layer} class="menu-layer" popover="manual">
      <div {...api.getPositionerProps()}>
        <div {...api.getContentProps()} class="menu" aria-label={label} aria-labelledby={undefined}>
          {entries.map((entry, index) => (
            <MenuRow key={isAction(entry) ? entry.id : index} api={api} entry={entry} />
          ))}
        </div>
      </div>
    </div>
  );
}

function MenuRow({ api, entry }: { api: Api; entry: MenuEntry }) {
  if (entry === "separator") return <hr class="menu-separator" />;
  if (!isAction(entry)) return <div class="menu-heading">{entry.heading}</div>;
  const { id, label, icon, shortcut, isDanger, disabled, isChecked } = entry;
  const isChoice = isChecked !== undefined;
  return (
    <div
      {...api.getItemProps({ value: id, disabled, valueText: label })}
      {...(isChoice ? { role: "menuitemradio", "aria-checked": isChecked } : {})}
      class={`menu-item ${isDanger ? "danger" : ""}`}
    >
      <span class="menu-icon">
        {isChecked ? <Icon name="check" /> : icon && <Icon name={icon} />}
      </span>
      <span class="menu-label">{label}</span>
      {shortcut && <Keys shortcut={shortcut} />}
    </div>
  );
}
