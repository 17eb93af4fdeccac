// Buttons and commands that change the view.
import { useSignal } from "@preact/signals";
import { type Command, useCommands } from "../commands";
import { IconButton } from "../ui/button";
import { MenuButton } from "../ui/menu";
import type { ViewName } from "./types";
import type { Viewer } from "./viewer";

const VIEWS: Record<ViewName, string> = {
  home: "Oblique",
  front: "Front",
  back: "Back",
  left: "Left",
  right: "Right",
  top: "Top",
  bottom: "Bottom",
};
const NAMES = Object.keys(VIEWS) as ViewName[];

/** Fit, standard views, and the projection. */
export function ViewTools({ viewer, isCovered }: { viewer: Viewer; isCovered: boolean }) {
  const isFlat = useSignal(false);
  const switchProjection = () => {
    isFlat.value = !isFlat.peek();
    viewer.rig.setProjection(isFlat.peek() ? "orthographic" : "perspective");
  };
  const canTurn = () => !viewer.rig.isFacing;
  useCommands((): readonly Command[] => [
    {
      id: "view.fit",
      label: "Fit the view to the body",
      group: "View",
      shortcut: "F",
      run: () => viewer.rig.fit(),
    },
    {
      id: "view.projection",
      label: "Switch between perspective and orthographic",
      group: "View",
      shortcut: "O",
      when: canTurn,
      run: switchProjection,
    },
    ...NAMES.map((name) => ({
      id: `view.${name}`,
      label: `View: ${VIEWS[name].toLowerCase()}`,
      group: "View",
      shortcut: name === "home" ? "Home" : undefined,
      when: canTurn,
      run: () => viewer.rig.look(name),
    })),
  ]);
  return (
    <div
      class="view-tools"
      role="toolbar"
      aria-label="View"
      aria-orientation="vertical"
      hidden={isCovered}
    >
      <IconButton
        icon="fit"
        label="Fit the view to the body"
        shortcut="F"
        onClick={() => viewer.rig.fit()}
      />
      <IconButton
        icon="part"
        label="Orthographic view"
        shortcut="O"
        isPressed={isFlat.value}
        onClick={() => canTurn() && switchProjection()}
      />
      <MenuButton
        label="Standard views"
        icon="make"
        entries={() =>
          NAMES.map((name) => ({
            id: name,
            label: VIEWS[name],
            disabled: !canTurn(),
            run: () => viewer.rig.look(name),
          }))
        }
      />
    </div>
  );
}
