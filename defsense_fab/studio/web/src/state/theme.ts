// Light and dark: the choice of this browser, or that of the system.
import { computed, effect, signal } from "@preact/signals";
import { storedSignal } from "./storage";

const THEMES = ["system", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

const isTheme = (value: unknown): value is Theme => THEMES.includes(value as Theme);

export const theme = storedSignal<Theme>("theme", "system", isTheme);

const query = matchMedia("(prefers-color-scheme: dark)");
const isSystemDark = signal(query.matches);
query.addEventListener("change", () => (isSystemDark.value = query.matches));

/** Whether the page is dark; for the scene, which style sheets do not reach. */
export const isDark = computed(() =>
  theme.value === "system" ? isSystemDark.value : theme.value === "dark",
);

effect(() => {
  if (theme.value === "system") document.documentElement.removeAttribute("data-theme");
  else document.documentElement.dataset["theme"] = theme.value;
});
