// The error on the surface in a state: fetched when it is chosen, drawn in place of the body.
import { effect, signal } from "@preact/signals";
import type { NumberArray } from "../../protocol/connection";
import { BodyLayer } from "../../scene/body-layer";
import { areCordsShown, isBodyShown } from "../../scene/stage";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { errorStates, isMapDeformed, mappedState } from "./state";

export interface ErrorMap {
  state: string;
  mean: number;
  largest: number;
  /** End of the color scale, the same for all states, mm. */
  high: number;
  arrays: Record<string, NumberArray>;
}

/** The map that is shown, or null. */
export const errorMap = signal<ErrorMap | null>(null);

/** Colors of the scale from 0 to its end, sRGB (the scale "viridis"). */
export const MAP_COLORS: readonly (readonly [number, number, number])[] = [
  [68, 1, 84],
  [72, 40, 120],
  [62, 74, 137],
  [49, 104, 142],
  [38, 130, 142],
  [31, 158, 137],
  [53, 183, 121],
  [109, 205, 89],
  [180, 222, 44],
  [253, 231, 37],
];

/** Show the map of the chosen state in a scene; return a function that removes it. */
export function attachErrorMap(viewer: Viewer): () => void {
  const layer = new BodyLayer(
    () => viewer.refresh(),
    () => viewer.refresh(),
  );
  viewer.scene.add(layer.object);
  const stops = [
    viewer.onTheme((colors) => layer.setTheme(colors)),
    effect(() => void fetchMap(mappedState.value, errorStates.value !== null)),
    effect(() => {
      const map = errorMap.value;
      layer.setVisible(map !== null);
      isBodyShown.value = areCordsShown.value = map === null;
      if (!map) return;
      const { rest, moved, faces, edges, error } = map.arrays;
      layer.set({ vertices: isMapDeformed.value ? moved! : rest!, faces: faces!, edges: edges! });
      layer.setColors(colorsOf(error!, map.high), true);
    }),
  ];
  return () => {
    for (const stop of stops) stop();
    viewer.scene.remove(layer.object);
    layer.dispose();
    isBodyShown.value = areCordsShown.value = true;
  };
}

async function fetchMap(state: string, isKnown: boolean): Promise<void> {
  if (!state || !isKnown) {
    errorMap.value = null;
    return;
  }
  const answer = await run(connection.fetch("error-map-of", { state }));
  if (mappedState.value !== state) return;
  if (!answer) mappedState.value = "";
  const { mean, largest, high } = (answer?.facts ?? {}) as Omit<ErrorMap, "arrays">;
  errorMap.value = answer ? { state, mean, largest, high, arrays: answer.arrays } : null;
}

function colorsOf(errors: NumberArray, high: number): Float32Array {
  const colors = new Float32Array(3 * errors.length);
  const last = MAP_COLORS.length - 1;
  for (let i = 0; i < errors.length; i++) {
    const position = Math.min(Math.max(errors[i]! / high, 0), 1) * last;
    const k = Math.min(Math.floor(position), last - 1);
    const t = position - k;
    for (let c = 0; c < 3; c++) {
      colors[3 * i + c] = ((1 - t) * MAP_COLORS[k]![c]! + t * MAP_COLORS[k + 1]![c]!) / 255;
    }
  }
  return colors;
}
