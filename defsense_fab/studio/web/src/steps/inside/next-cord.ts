// The search for the best place of another cord in the plane of a section.
import { batch, computed, effect, signal, untracked } from "@preact/signals";
import type { ArrayMessage } from "../../protocol/connection";
import { connection, device } from "../../state/connection";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { showProblem, showToast } from "../../state/toasts";
import { inside, type QuantityName, type SectionView } from "./section-view";

/** Time without a change of the plane after which the search starts, ms. */
const START_MS = 350;

/** What one more cord would change, at the points of a grid. */
export interface CordMap {
  /** Points (p, 3), mm at rest. */
  points: Float32Array;
  /** Decrease of the expected error (p,), mm; NaN where no cord fits. */
  drop: Float32Array;
  /** Ends (p, 2, 3) of the best cord through each point, mm at rest. */
  ends: Float32Array;
  /** Distance of the points, mm. */
  step: number;
}

export const search = connection.event("next-cord-state");

export class NextCordTool {
  /** Whether the section shows where another cord would help. */
  readonly isOn = signal(false);
  /** Length of the cords that are tried, mm; null for cords from surface to surface. */
  readonly length = signal<number | null>(null);
  readonly map = signal<CordMap | null>(null);
  readonly isAdding = signal(false);
  /** Whether a search is about to start, so that an earlier one no longer counts. */
  readonly isDue = signal(false);
  /** Ends (2, 3) of the cord under the pointer, else of the best one; mm at rest. */
  readonly candidate = computed<number[][] | null>(() => {
    if (!this.isOn.value || !this.map.value) return null;
    const point = this.view.hover.value?.rest ?? this.view.picked.value?.rest;
    const hovered = point && cordThrough(this.map.value, point);
    const best = search.value?.ends ?? [];
    return hovered || (best.length ? best : null);
  });

  private lastQuantity: QuantityName = "largest";
  private timer = 0;

  constructor(private readonly view: SectionView) {}

  /** Follow the plane, the cords and the server; return a function to stop. */
  open(): () => void {
    const stops = [
      effect(() => this.follow()),
      connection.onArrays("next-cord", (message) => this.show(message)),
      connection.listen("next-cord-state", ({ state, hasMap, problem }) => {
        const isNew = state === "searching" && !hasMap;
        if (isNew || ["none", "outdated", "failed"].includes(state)) this.map.value = null;
        if (problem && this.isOn.peek()) showProblem(problem);
      }),
    ];
    return () => {
      for (const stop of stops) stop();
      clearTimeout(this.timer);
      this.turn(false);
    };
  }

  /** Show where another cord would help, or the quantity that was shown before. */
  turn(isOn: boolean): void {
    if (isOn === this.isOn.peek()) return;
    batch(() => {
      this.isOn.value = isOn;
      if (isOn) this.lastQuantity = this.view.quantity.peek();
      this.view.quantity.value = isOn ? "next-cord" : this.lastQuantity;
    });
    if (!isOn) void this.stop(false);
  }

  /** Cancel the search; a map that was found stays. */
  cancel(): void {
    clearTimeout(this.timer);
    void this.stop(true);
  }

  /** Add the best cord, or the best one through a point (3,) at rest. */
  async add(at: readonly number[] | null): Promise<void> {
    this.isAdding.value = true;
    const added = await run(connection.send("add-next-cord", { at: at && [...at] }));
    this.isAdding.value = false;
    if (!added) return;
    select({ kind: "cord", name: added.name });
    const undo = { label: "Undo", run: () => void run(connection.send("undo", {})) };
    const isShort = this.length.peek() !== null;
    const note = isShort ? ". Its ends are inside the body: drag them to the surface" : "";
    showToast(`Added ${added.name}${note}`, undo);
  }

  /** Decrease of the error by a cord through a point (3,) at rest, mm; null where none fits. */
  dropAt(point: readonly number[]): number | null {
    const map = this.map.peek();
    const index = map ? nearest(map, point) : -1;
    return index < 0 ? null : map!.drop[index]!;
  }

  /** What a cord through a point (3,) at rest would change, in words. */
  textAt(point: readonly number[]): string {
    if (!this.map.peek()) return search.peek()?.state === "searching" ? "Searching" : "";
    const noun = device.peek()?.noun ?? "cord";
    const drop = this.dropAt(point);
    if (drop === null) return `No ${noun} fits here`;
    const sign = drop >= 0.005 ? "\u2212" : drop <= -0.005 ? "+" : "";
    return `A ${noun} here: error ${sign}${Math.abs(drop).toFixed(2)} mm`;
  }

  private follow(): void {
    clearTimeout(this.timer);
    const plane = this.view.plane.value;
    const length = this.length.value;
    const cords = device.value?.cords;
    const isReady = inside.value?.isReady ?? false;
    if (!this.isOn.value || !plane || !isReady || !cords) return;
    untracked(() => {
      this.map.value = null;
      this.isDue.value = true;
    });
    const timer = window.setTimeout(() => {
      const { origin, axes } = plane;
      connection
        .send("search-next-cord", { origin, axes, length })
        .catch(() => {
          // A plane that misses the body is reported by its section.
        })
        .finally(() => {
          if (timer === this.timer) this.isDue.value = false;
        });
    }, START_MS);
    this.timer = timer;
  }

  private show({ arrays, facts }: ArrayMessage): void {
    if (!this.isOn.peek()) return;
    this.map.value = {
      points: arrays["points"] as Float32Array,
      drop: arrays["drop"] as Float32Array,
      ends: arrays["ends"] as Float32Array,
      step: facts["step"],
    };
    this.view.refresh();
  }

  private async stop(keepsMap: boolean): Promise<void> {
    if (!keepsMap) this.map.value = null;
    if (search.peek()) await run(connection.send("stop-next-cord", { keepsMap }));
  }
}

function cordThrough(map: CordMap, point: readonly number[]): number[][] | null {
  const index = nearest(map, point);
  if (index < 0) return null;
  const ends = [...map.ends.subarray(6 * index, 6 * index + 6)];
  return [ends.slice(0, 3), ends.slice(3)];
}

/** Index of the nearest point at which a cord fits, not farther than a step; else -1. */
function nearest({ points, drop, step }: CordMap, point: readonly number[]): number {
  let [best, smallest] = [-1, step * step];
  for (let i = 0; i < drop.length; i++) {
    if (Number.isNaN(drop[i]!)) continue;
    let distance = 0;
    for (let k = 0; k < 3; k++) distance += (points[3 * i + k]! - point[k]!) ** 2;
    if (distance <= smallest) [best, smallest] = [i, distance];
  }
  return best;
}
