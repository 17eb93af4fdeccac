// Colors of the scene, light and dark; they follow the page's theme.

export interface SceneColors {
  /** Upper and lower color of the background. */
  sky: string;
  ground: string;
  body: string;
  edge: string;
  shadow: number;
  outline: string;
  hover: string;
  broken: string;
}

const LIGHT: SceneColors = {
  sky: "#fafbfc",
  ground: "#dde2e8",
  body: "#c9d0d8",
  edge: "#5b6673",
  shadow: 0.42,
  outline: "#101b2a",
  hover: "#3d4b5c",
  broken: "#d11a2a",
};

const DARK: SceneColors = {
  sky: "#2b3138",
  ground: "#15181c",
  body: "#79838f",
  edge: "#c3ccd6",
  shadow: 0.7,
  outline: "#ffffff",
  hover: "#c3ccd6",
  broken: "#ff5a5f",
};

const SYSTEM = matchMedia("(prefers-color-scheme: dark)");

export function isDark(): boolean {
  const theme = document.documentElement.dataset.theme;
  return theme === "dark" || (theme !== "light" && SYSTEM.matches);
}

export function sceneColors(): SceneColors {
  return isDark() ? DARK : LIGHT;
}

/** Call a function whenever the theme changes; return a function to stop. */
export function onThemeChange(action: () => void): () => void {
  const observer = new MutationObserver(action);
  observer.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  SYSTEM.addEventListener("change", action);
  return () => {
    observer.disconnect();
    SYSTEM.removeEventListener("change", action);
  };
}
