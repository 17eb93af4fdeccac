// The parts in a scene: surfaces with edges, and the cords, wires and pins of a step.
import { Box3, Group, Vector3 } from "three";
import type { ArrayMessage, NumberArray } from "../../protocol/connection";
import type { PartState } from "../../protocol/messages";
import { BodyLayer } from "../../scene/body-layer";
import { CordLayer } from "../../scene/cord-layer";
import { type SceneColors, sceneColors } from "../../scene/theme";
import type { Arrangement, PartPlacement } from "./arrangement";

const WIRE_COLOR = "#1f77b4";
const PIN_COLOR = "#e3c65a";
/** Of the lines between which must be no glue, and their radius, mm. */
const GLUELESS_COLOR = "#e00000";
const GLUELESS_RADIUS = 0.5;
const FADED_OPACITY = 0.25;

interface Entry {
  layer: BodyLayer;
  color: string;
  center: Vector3;
  placement: PartPlacement;
}

/** Sizes of what a step shows next to the parts, mm. */
export interface Radii {
  cord: number;
  wire: number;
}

export class PartsLayer {
  readonly object = new Group();
  private readonly entries = new Map<string, Entry>();
  private readonly lines = new Map<string, CordLayer>();
  private colors: SceneColors = sceneColors();
  private selected: string | null = null;
  private hovered: string | null = null;

  constructor(private readonly onChange: () => void) {}

  /** Show other parts, with the arrays of `part-meshes`. */
  setMeshes({ arrays, facts }: ArrayMessage, parts: readonly PartState[]): void {
    this.clear();
    const colors = new Map(parts.map(({ name, color }) => [name, color]));
    (facts.names as string[]).forEach((name, k) => {
      const layer = new BodyLayer(this.onChange, this.onChange);
      layer.set(partArrays(arrays, k));
      const center = layer.box.getCenter(new Vector3());
      const placement = { shift: [0, 0, 0], opacity: 1, isVisible: true };
      this.entries.set(name, { layer, color: colors.get(name) ?? "#888888", center, placement });
      this.object.add(layer.object);
    });
    this.style();
  }

  /** Move the parts and show what belongs to a step; hidden parts stay hidden. */
  apply(arrangement: Arrangement, radii: Radii, hidden: ReadonlySet<string>, isFaded = false): void {
    for (const [name, entry] of this.entries) {
      const placement = arrangement.parts.get(name);
      if (!placement) continue;
      const isVisible = placement.isVisible && !hidden.has(name);
      entry.placement = { ...placement, isVisible };
      entry.layer.object.position.fromArray(placement.shift as number[]);
      entry.layer.setOpacity(isFaded ? FADED_OPACITY : placement.opacity);
      entry.layer.setVisible(isVisible);
    }
    const tubes = new Map<number, { name: string; color: string; path: number[][] }[]>();
    const add = (radius: number, name: string, color: string, path: number[][]) => {
      tubes.set(radius, [...(tubes.get(radius) ?? []), { name, color, path }]);
    };
    for (const { name, color, path } of arrangement.cords) add(radii.cord, name, color, path);
    arrangement.wires.forEach((wire, k) => add(radii.wire, `wire ${k}`, WIRE_COLOR, wire));
    arrangement.glueless.forEach((line, k) => add(GLUELESS_RADIUS, `no glue ${k}`, GLUELESS_COLOR, line));
    for (const { letter, start, end, radius } of arrangement.pins) {
      add(radius, `pin ${letter}`, PIN_COLOR, [start, end]);
    }
    const kinds = [...tubes].map(([radius, shown]) => ({ radius, shown }));
    this.showTubes(kinds);
    this.onChange();
  }

  setTheme(colors: SceneColors): void {
    this.colors = colors;
    for (const layer of this.lines.values()) layer.setTheme(colors);
    this.style();
  }

  setSelected(name: string | null): void {
    this.selected = name;
    this.style();
  }

  setHovered(name: string | null): void {
    if (name === this.hovered) return;
    this.hovered = name;
    this.style();
  }

  /** The box of what is visible, also of parts that are moved. */
  box(): Box3 {
    const all = new Box3();
    for (const { layer, placement } of this.entries.values()) {
      const shift = new Vector3().fromArray(placement.shift as number[]);
      if (placement.isVisible) all.union(layer.box.clone().translate(shift));
    }
    return all;
  }

  /** The visible parts that are not transparent, with their middles (3,), mm. */
  middles(): { name: string; at: number[] }[] {
    return [...this.entries].flatMap(([name, { center, placement }]) =>
      placement.isVisible && placement.opacity === 1
        ? [{ name, at: center.toArray().map((mm, axis) => mm + placement.shift[axis]!) }]
        : [],
    );
  }

  /** The part that a ray hits first, or null. */
  pick(origin: readonly number[], direction: readonly number[]): string | null {
    let best: string | null = null;
    let nearest = Infinity;
    for (const [name, { layer, placement }] of this.entries) {
      if (!placement.isVisible) continue;
      const from = origin.map((mm, axis) => mm - placement.shift[axis]!);
      const { face, distance } = layer.intersect(from, direction);
      if (face >= 0 && distance < nearest) {
        nearest = distance;
        best = name;
      }
    }
    return best;
  }

  dispose(): void {
    this.clear();
    for (const layer of this.lines.values()) layer.dispose();
    this.lines.clear();
  }

  private showTubes(
    kinds: { radius: number; shown: { name: string; color: string; path: number[][] }[] }[],
  ): void {
    const keys = new Set(kinds.map(({ radius }) => String(radius)));
    for (const [key, layer] of this.lines) if (!keys.has(key)) layer.set([], 1);
    for (const { radius, shown } of kinds) {
      const key = String(radius);
      let layer = this.lines.get(key);
      if (!layer) {
        layer = new CordLayer(this.onChange, this.onChange);
        layer.setTheme(this.colors);
        this.lines.set(key, layer);
        this.object.add(layer.object);
      }
      layer.set(
        shown.map((tube) => ({ ...tube, isVisible: true })),
        radius,
      );
    }
  }

  private style(): void {
    for (const [name, { layer, color }] of this.entries) {
      const isSelected = name === this.selected;
      const isHovered = name === this.hovered;
      layer.setTheme({
        ...this.colors,
        body: isHovered || isSelected ? mixed(color, "#ffffff", 0.25) : color,
        edge: isSelected ? this.colors.outline : isHovered ? this.colors.hover : this.colors.edge,
      });
    }
    this.onChange();
  }

  private clear(): void {
    for (const { layer } of this.entries.values()) {
      this.object.remove(layer.object);
      layer.dispose();
    }
    this.entries.clear();
  }
}

function partArrays(arrays: Record<string, NumberArray>, k: number): Record<string, NumberArray> {
  return {
    vertices: arrays[`${k}/vertices`]!,
    faces: arrays[`${k}/faces`]!,
    edges: arrays[`${k}/edges`]!,
  };
}

function mixed(first: string, second: string, share: number): string {
  const channel = (color: string, k: number) => parseInt(color.slice(2 * k + 1, 2 * k + 3), 16);
  const values = [0, 1, 2].map((k) =>
    Math.round((1 - share) * channel(first, k) + share * channel(second, k)),
  );
  return `#${values.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}
