// Keys of focused things, which are not commands; for the list of keys.
export interface KeyNote {
  group: string;
  label: string;
  shortcut: string;
}

const ARROWS = "\u2190 \u2191 \u2193 \u2192";

export const KEY_NOTES: readonly KeyNote[] = [
  ["Scene", "Turn the view", ARROWS],
  ["Scene", "Move the view", `Shift+${ARROWS}`],
  ["Scene", "Zoom in or out", "Plus \u2212"],
  ["Point, plane or region in focus", "Move it 0.5 mm as the screen shows it", ARROWS],
  ["Point, plane or region in focus", "Move it 5 mm", `Shift+${ARROWS}`],
  ["Point, plane or region in focus", "Delete the point", "Delete"],
  ["Drawing", "Move the pen 0.5 mm", ARROWS],
  ["Drawing", "Move the pen 5 mm", `Shift+${ARROWS}`],
  ["Drawing", "Put a point", "Space"],
  ["Drawing", "Remove the last point", "Backspace"],
  ["Drawing", "Finish, on the last point", "Enter"],
  ["Fields", "Commit the value", "Enter"],
  ["Fields", "Change a number by a step", "\u2191 \u2193"],
  ["Fields", "Change a number by ten steps", "Shift+\u2191 \u2193"],
  ["Tree", "Select, or add to the selection", "Enter Space"],
  ["Tree", "Open the menu of an item", "Shift+F10"],
].map(([group, label, shortcut]) => ({ group: group!, label: label!, shortcut: shortcut! }));
