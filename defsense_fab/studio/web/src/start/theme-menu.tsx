import { type Theme, theme } from "../state/theme";
import { MenuButton, type MenuEntry } from "../ui/menu";

const CHOICES: readonly { value: Theme; label: string; icon: "monitor" | "sun" | "moon" }[] = [
  { value: "system", label: "As the system", icon: "monitor" },
  { value: "light", label: "Light", icon: "sun" },
  { value: "dark", label: "Dark", icon: "moon" },
];

/** The menu of the page's appearance. */
export function ThemeMenu() {
  const icon = CHOICES.find(({ value }) => value === theme.value)?.icon ?? "monitor";
  return <MenuButton label="Appearance" icon={icon} entries={entries} />;
}

function entries(): MenuEntry[] {
  return CHOICES.map(({ value, label, icon }) => ({
    id: `theme-${value}`,
    label,
    icon,
    isChecked: theme.value === value,
    run: () => {
      theme.value = value;
    },
  }));
}
