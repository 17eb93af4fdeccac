import { screen, showAllDevices } from "../state/step";
import { type Theme, theme } from "../state/theme";
import { isKeyHelpOpen, isPaletteOpen } from "../ui/command-palette";
import type { IconName } from "../ui/icons";
import { MenuButton, type MenuEntry } from "../ui/menu";
import { startIntroduction } from "./introduction";

const THEME_CHOICES: readonly { value: Theme; label: string; icon: IconName }[] = [
  { value: "system", label: "As the system", icon: "monitor" },
  { value: "light", label: "Light", icon: "sun" },
  { value: "dark", label: "Dark", icon: "moon" },
];

/** The menu of the page; that of the start page has the appearance alone. */
export function PageMenu() {
  return <MenuButton label="Menu" icon="menu" entries={menuEntries} />;
}

function menuEntries(): MenuEntry[] {
  return screen.value === "device"
    ? [...deviceEntries(), ...appearanceEntries()]
    : appearanceEntries();
}

function appearanceEntries(): MenuEntry[] {
  return [
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
  ];
}

function deviceEntries(): MenuEntry[] {
  return [
    { id: "devices", label: "All devices", icon: "devices", run: showAllDevices },
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
    "separator",
  ];
}
