import { runCommand } from "../commands";
import { device } from "../state/connection";
import { isDrawerOpen, isLeftPanelOpen, isPhone } from "../state/layout";
import { IconButton } from "../ui/button";
import { DeviceName } from "./device-name";
import { NextButton } from "./next-button";
import { PageMenu } from "./page-menu";
import { PipelineBar } from "./pipeline-bar";

/** Device, undo, steps, and the next action. */
export function TopBar() {
  const { undoName = "", redoName = "" } = device.value ?? {};
  const panel = isPhone.value ? isDrawerOpen : isLeftPanelOpen;
  return (
    <header class="top-bar">
      <h1 class="visually-hidden">{device.value?.name}</h1>
      <div class="top-start">
        <IconButton
          icon="sidebar"
          label={panel.value ? "Hide the list of parts" : "Show the list of parts"}
          aria-expanded={panel.value}
          onClick={() => (panel.value = !panel.value)}
        />
        <DeviceName />
        <span class="top-undo">
          <IconButton
            icon="undo"
            label="Undo"
            hint={undoName ? `Undo: ${undoName}` : "Nothing to undo"}
            shortcut="Mod+Z"
            disabled={!undoName}
            onClick={() => runCommand("undo")}
          />
          <IconButton
            icon="redo"
            label="Redo"
            hint={redoName ? `Redo: ${redoName}` : "Nothing to redo"}
            shortcut="Mod+Shift+Z"
            disabled={!redoName}
            onClick={() => runCommand("redo")}
          />
        </span>
      </div>
      <PipelineBar />
      <div class="top-end">
        {!isPhone.value && <NextButton />}
        <PageMenu />
      </div>
    </header>
  );
}
