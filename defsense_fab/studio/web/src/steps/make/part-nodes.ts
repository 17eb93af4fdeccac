// The parts in the tree of the device.
import {
  hovered,
  isHidden,
  isHovered,
  isSelected,
  select,
} from "../../state/selection";
import { openContextMenuFor } from "../../ui/menu";
import type { TreeNode } from "../../ui/tree";
import { partMenu } from "./part-menu";
import { partItem, parts, togglePart } from "./state";

/** The group of the built parts; nothing before they are built. */
export function partNodes(): TreeNode[] {
  const children = parts.value.map(({ name, color }) => {
    const item = partItem(name);
    const isOff = isHidden(item);
    return {
      id: `part:${name}`,
      label: name,
      color,
      isSelected: isSelected(item),
      isHovered: isHovered(item),
      isDimmed: isOff,
      buttons: [
        {
          icon: isOff ? ("eyeOff" as const) : ("eye" as const),
          label: `${isOff ? "Show" : "Hide"} ${name}`,
          isOn: isOff,
          run: () => togglePart(name),
        },
      ],
      onSelect: (isAdded: boolean) => select(item, isAdded),
      onHover: (isOver: boolean) => (hovered.value = isOver ? item : null),
      onMenu: (event: MouseEvent) => {
        select(item);
        openContextMenuFor(event, `Actions for ${name}`, partMenu(name));
      },
    };
  });
  return children.length === 0 ? [] : [{ id: "parts", label: "Parts", children, count: children.length }];
}
