import { Button, IconButton } from "../../ui/button";
import { MenuButton } from "../../ui/menu";
import { runCommand } from "../../commands";
import { addPose, addRegion, SHAPES } from "./commands";
import { startRectangle } from "./rectangle";
import { editedRegion, grip, isMeshed, regions, sceneTool, shownPose } from "./state";

/** The tools of the step, over the scene. */
export function PosesToolbar() {
  const canPose = regions.value.length > 1;
  return (
    <div class="poses-toolbar">
      <Button
        icon="plus"
        hint={canPose ? "Add a pose that holds one region and turns another" : "A pose needs two regions"}
        disabled={!canPose}
        onClick={() => void addPose()}
      >
        Pose
      </Button>
      <MenuButton
        label="Add a region"
        icon="plus"
        entries={() =>
          SHAPES.map(({ value, label }) => ({
            id: value,
            label,
            icon: "region",
            run: () => void addRegion(value),
          }))
        }
      >
        Region
      </MenuButton>
      <IconButton
        icon="region"
        label="Draw a rectangle to add a region"
        hint="Draw a rectangle to add a region. Shift and drag does the same"
        shortcut="R"
        isPressed={sceneTool.value === "rectangle"}
        disabled={!isMeshed.value}
        onClick={() => (sceneTool.value === "rectangle" ? (sceneTool.value = "view") : startRectangle(false))}
      />
      <IconButton
        icon="arrowRight"
        label="Pull at a point of the body"
        hint={shownPose.value ? "Click the body to pull at a point of it" : "Choose a pose first"}
        isPressed={sceneTool.value === "pull"}
        disabled={!shownPose.value || !isMeshed.value}
        onClick={() => runCommand("pose.pull")}
      />
    </div>
  );
}

/** What to do with the chosen tool; over the scene. */
export function PosesLegend() {
  return <p class="poses-hint">{hint()}</p>;
}

function hint(): string {
  if (!isMeshed.value) return "";
  if (sceneTool.value === "rectangle") return "Drag a rectangle over the body. Esc: stop";
  if (sceneTool.value === "pull") return "Click the point of the body to pull at. Esc: stop";
  if (editedRegion.value) return "Drag a dot to change the size, an arrow to move";
  if (grip.value) return "Drag a ring to turn, an arrow to move. Ctrl: finer, Shift: coarser";
  return "Shift and drag over the body: add a region";
}
