import { device } from "../state/connection";
import { isDrawerOpen, isLeftPanelOpen, isPhone } from "../state/layout";
import { showAllDevices } from "../state/step";
import { type Theme, theme } from "../state/theme";
import { runCommand } from "../commands";
import { IconButton } from "../ui/button";
import { isKeyHelpOpen, isPaletteOpen } from "../ui/command-palette";
import type { IconName } from "../ui/icons";
import { MenuButton, type MenuEntry } from "../ui/menu";
import { DeviceName } from "./device-name";
import { startIntroduction } from "./introduction";
import { NextButton } from "./next-button";
import { PipelineBar } from "./pipeline-bar";

/** Device, undo, steps, and what comes next. */
export function TopBar() {
  const { undoName = "", redoName = "" } = device.value ?? {};
  const panel = isPhone.value ? isDrawerOpen : isLeftPanelOpen;
  return (
    <header class="top-bar">
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
        <MenuButton label="Menu" icon="menu" entries={menuEntries} />
      </div>
    </header>
  );
}

const THEME_CHOICES: readonly { value: Theme; label: string; icon: IconName }[] = [
  { value: "system", label: "As the system", icon: "monitor" },
  { value: "light", label: "Light", icon: "sun" },
  { value: "dark", label: "Dark", icon: "moon" },
];

function menuEntries(): MenuEntry[] {
  return [
    { id: "devices", label: "All devices", icon: "devices", run: showAllDevices },
    "separator",
    { heading: "Appearance" },
    ...THEME_CHOICES.map(({ value, label, icon }) => ({
      id: `theme-${value}`,
      label,
      icon,
      isChecked: theme.value === value,
      run: () => {
        theme.value = value;
      },
    })),
    "separator",
    {
      id: "palette",
      label: "Commands",
      icon: "command",
      shortcut: "Mod+K",
      run: () => {
        isPaletteOpen.value = true;
      },
    },
    {
      id: "keys",
      label: "Keyboard shortcuts",
      icon: "keyboard",
      shortcut: "?",
      run: () => {
        isKeyHelpOpen.value = true;
      },
    },
    { id: "introduction", label: "Introduction", icon: "info", run: startIntroduction },
  ];
}
