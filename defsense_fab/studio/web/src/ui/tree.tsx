// A tree of named things with arrow keys, selection, renaming in place and icons at the right.
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { panelState } from "../state/layout";
import { IconButton } from "./button";
import { Icon, type IconName } from "./icons";
import { NameInput } from "./name-input";
import { tooltip } from "./tooltip";

export interface TreeNode {
  id: string;
  label: string;
  icon?: IconName;
  /** Address of a small picture, in place of an icon. */
  picture?: string;
  /** Color of a swatch, in place of an icon. */
  color?: string;
  /** Whether the swatch has an outline, as those of regions. */
  hasOutline?: boolean;
  /** Number at the right of a group. */
  count?: number;
  /** A broken limit, shown as a red mark. */
  problem?: string;
  isDimmed?: boolean;
  isSelected?: boolean;
  isHovered?: boolean;
  buttons?: readonly TreeButton[];
  children?: readonly TreeNode[];
  onSelect?: (isAdded: boolean) => void;
  onHover?: (isHovered: boolean) => void;
  /** Called when it is clicked twice beside its name, which is renamed. */
  onOpen?: () => void;
  /** Rename it; return why the name is refused, or null. */
  onRename?: (name: string) => Promise<string | null>;
  /** Replaces what cannot be part of the name while it is typed, and says so. */
  fixName?: (text: string) => string;
  fixNote?: string;
  onDelete?: () => void;
  onMenu?: (event: MouseEvent) => void;
}

export interface TreeButton {
  icon: IconName;
  label: string;
  /** Whether it stays visible without the pointer on the row. */
  isOn: boolean;
  hint?: string;
  run: () => void;
}

interface Row {
  node: TreeNode;
  level: number;
  parent: TreeNode | null;
}

interface TreeProps {
  label: string;
  nodes: readonly TreeNode[];
  /** Identifier of the node whose name is edited. */
  renaming: string | null;
  onRenaming: (id: string | null) => void;
}

const LONG_NAME = 18; // characters, which may not fit in the row

/** Whether a node that has children shows them. */
const openState = (id: string) => panelState(`tree.${id}`);

function visibleRows(nodes: readonly TreeNode[], level = 1, parent: TreeNode | null = null): Row[] {
  return nodes.flatMap((node) => [
    { node, level, parent },
    ...(node.children && openState(node.id).value
      ? visibleRows(node.children, level + 1, node)
      : []),
  ]);
}

export function Tree({ label, nodes, renaming, onRenaming }: TreeProps) {
  const root = useRef<HTMLDivElement>(null);
  const active = useSignal("");
  const rows = visibleRows(nodes);
  const activeId = rows.some(({ node }) => node.id === active.value)
    ? active.value
    : rows[0]?.node.id;

  const focus = (row: Row | undefined) => {
    if (!row) return;
    active.value = row.node.id;
    root.current?.querySelector<HTMLElement>(`[data-node="${CSS.escape(row.node.id)}"]`)?.focus();
  };

  const latestRows = useRef(rows);
  latestRows.current = rows;
  const focusRow = (index: number) => focus(latestRows.current[index]);

  // A row in focus that is renamed or deleted passes the focus to the row in its place.
  const focusedAt = useRef<number | null>(null);
  useLayoutEffect(() => {
    if (focusedAt.current === null || document.activeElement !== document.body) return;
    focus(rows[Math.min(focusedAt.current, rows.length - 1)]);
  });
  const onFocusOut = ({ target, relatedTarget }: FocusEvent) => {
    if (relatedTarget instanceof Node && root.current?.contains(relatedTarget)) return;
    queueMicrotask(() => {
      if ((target as Element).isConnected) focusedAt.current = null;
    });
  };

  const onKeyDown = (event: KeyboardEvent) => {
    const target = event.target as HTMLElement;
    const at = rows.findIndex(({ node }) => node.id === target.dataset["node"]);
    const row = rows[at];
    if (!row || event.ctrlKey || event.metaKey || event.altKey) return;
    const { node, parent } = row;
    const isOpen = node.children ? openState(node.id).value : null;
    const keys: Record<string, () => void> = {
      ArrowDown: () => focus(rows[at + 1]),
      ArrowUp: () => focus(rows[at - 1]),
      Home: () => focus(rows[0]),
      End: () => focus(rows.at(-1)),
      ArrowRight: () => {
        if (isOpen === false) openState(node.id).value = true;
        else if (isOpen) focus(rows[at + 1]);
      },
      ArrowLeft: () => {
        if (isOpen) openState(node.id).value = false;
        else focus(rows.find((other) => other.node === parent));
      },
      Enter: () => (node.onSelect ? node.onSelect(false) : toggle(node)),
      " ": () => (node.onSelect ? node.onSelect(true) : toggle(node)),
      ...(node.onRename ? { F2: () => onRenaming(node.id) } : {}),
      ...(node.onDelete ? { Delete: node.onDelete } : {}),
    };
    const action = keys[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  };

  return (
    <div
      ref={root}
      class="tree"
      role="tree"
      aria-label={label}
      aria-multiselectable="true"
      onKeyDown={onKeyDown}
      onFocusOut={onFocusOut}
    >
      {rows.map((row, index) => (
        <TreeRow
          key={row.node.id}
          {...row}
          isActive={row.node.id === activeId}
          isRenaming={renaming === row.node.id}
          onActive={() => {
            active.value = row.node.id;
            focusedAt.current = index;
          }}
          onRenaming={() => onRenaming(row.node.id)}
          onRenamed={() => {
            onRenaming(null);
            const hadFocus = root.current?.contains(document.activeElement);
            if (hadFocus) setTimeout(() => focusRow(index));
          }}
        />
      ))}
    </div>
  );
}

function toggle(node: TreeNode): void {
  const state = openState(node.id);
  state.value = !state.value;
}

interface TreeRowProps extends Row {
  isActive: boolean;
  isRenaming: boolean;
  onActive: () => void;
  onRenaming: () => void;
  onRenamed: () => void;
}

function TreeRow(props: TreeRowProps) {
  const { node, level, isActive, isRenaming, onActive, onRenaming, onRenamed } = props;
  const { id, label, children, problem, buttons = [] } = node;
  return (
    <div
      role="treeitem"
      class={`tree-row ${node.isHovered ? "hovered" : ""} ${node.isDimmed ? "dimmed" : ""} ${children ? "group" : ""}`}
      data-node={id}
      tabIndex={isActive ? 0 : -1}
      aria-label={problem ? `${label}: ${problem}` : label}
      aria-level={level}
      aria-expanded={children ? openState(id).value : undefined}
      aria-selected={node.onSelect ? Boolean(node.isSelected) : undefined}
      style={{ "--level": String(level) }}
      onFocus={onActive}
      onClick={(event) => {
        if (node.onSelect) node.onSelect(event.ctrlKey || event.metaKey || event.shiftKey);
        else toggle(node);
      }}
      onDblClick={node.onOpen}
      onContextMenu={node.onMenu}
      onPointerEnter={() => node.onHover?.(true)}
      onPointerLeave={() => node.onHover?.(false)}
    >
      {children && (
        <span class="tree-arrow">
          <Icon name="chevronRight" size={14} />
        </span>
      )}
      {node.picture ? (
        <img class="tree-picture" src={node.picture} alt="" draggable={false} />
      ) : node.color ? (
        <span class={`swatch ${node.hasOutline ? "region" : ""}`} style={{ background: node.color }} />
      ) : (
        node.icon && <Icon name={node.icon} />
      )}
      {isRenaming ? (
        <NameInput
          name={label}
          fix={node.fixName}
          fixNote={node.fixNote}
          onRename={async (name) => (await node.onRename?.(name)) ?? null}
          onDone={onRenamed}
        />
      ) : (
        <span
          class="tree-label"
          onDblClick={(event) => {
            if (!node.onRename) return;
            event.stopPropagation();
            onRenaming();
          }}
          {...tooltip(label.length > LONG_NAME ? label : undefined)}
        >
          {label}
        </span>
      )}
      {node.count !== undefined && <span class="tree-count" data-count={node.count} />}
      <TreeButtons buttons={buttons} />
      {problem && (
        <span class="tree-problem" {...tooltip(problem)}>
          <Icon name="warning" size={14} />
        </span>
      )}
    </div>
  );
}

function TreeButtons({ buttons }: { buttons: readonly TreeButton[] }): ComponentChildren {
  return buttons.map(({ icon, label, isOn, hint, run }) => (
    <IconButton
      key={label}
      icon={icon}
      label={label}
      hint={hint}
      class={isOn ? "on" : ""}
      tabIndex={-1}
      onClick={(event) => {
        event.stopPropagation();
        run();
      }}
    />
  ));
}
