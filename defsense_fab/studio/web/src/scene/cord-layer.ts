// The cords: tubes that stay visible through the body, with hover, selection and broken parts.
import { type Color, Group, Mesh, type ShaderMaterial, type Vector2 } from "three";
import { ORDER } from "./order";
import { tubeMaterial } from "./shading";
import type { SceneColors } from "./theme";
import { Tube } from "./tube";

const HIDDEN_OPACITY = 0.78;
const OUTLINE_PX = 2.5;
/** Width of a pair of stripes on a broken part, in radii. */
const STRIPE_RADII = 1.5;

/** A cord as it is shown. */
export interface ShownCord {
  name: string;
  color: string;
  /** Points (p, 3) along its path, mm. */
  path: number[][];
  isVisible: boolean;
}

interface Entry {
  cord: ShownCord;
  tube: Tube;
  visible: Mesh<Tube["geometry"], ShaderMaterial>;
  hidden: Mesh<Tube["geometry"], ShaderMaterial>;
  outline: Mesh<Tube["geometry"], ShaderMaterial>;
}

export class CordLayer {
  readonly object = new Group();
  private readonly entries = new Map<string, Entry>();
  private radius = 1;
  private thinning = 1;
  private broken: number[][] = [];
  private selected: ReadonlySet<string> = new Set();
  private hovered = "";
  private colors: SceneColors | null = null;
  private size: [number, number] = [1, 1];

  constructor(
    private readonly onChange: () => void,
    private readonly onMove: () => void,
  ) {}

  /** Radius of the cords as they are shown, mm. */
  get shownRadius(): number {
    return this.radius * this.thinning;
  }

  /** The cords that are shown. */
  get cords(): ShownCord[] {
    return [...this.entries.values()].map(({ cord }) => cord);
  }

  /** Show these cords with a radius, mm; others are removed. */
  set(cords: ShownCord[], radius: number): void {
    const isThicker = radius !== this.radius;
    this.radius = radius;
    const names = new Set(cords.map(({ name }) => name));
    for (const name of [...this.entries.keys()]) if (!names.has(name)) this.remove(name);
    for (const cord of cords) {
      const entry = this.entries.get(cord.name) ?? this.add(cord);
      const isMoved = isThicker || entry.cord.path !== cord.path || entry.tube.isEmpty;
      entry.cord = cord;
      if (isMoved) this.shape(entry);
    }
    this.style();
  }

  /** Show another path of a cord, as while it is dragged. */
  setPath(name: string, path: number[][]): void {
    const entry = this.entries.get(name);
    if (!entry) return;
    entry.cord.path = path;
    this.shape(entry);
    this.onMove();
  }

  /** Change the color of a cord, as of one that is live. */
  setColor(name: string, shown: string): void {
    const entry = this.entries.get(name);
    if (!entry || entry.cord.color === shown) return;
    entry.cord.color = shown;
    for (const mesh of [entry.visible, entry.hidden]) color(mesh, "base").set(shown);
    this.onMove();
  }

  /** Mark the parts of cords near these places (b, 3), mm. */
  setBroken(places: number[][]): void {
    this.broken = places;
    for (const entry of this.entries.values()) this.shape(entry);
    this.onChange();
  }

  setSelected(names: ReadonlySet<string>): void {
    this.selected = names;
    this.style();
  }

  setHovered(name: string): void {
    if (name === this.hovered) return;
    this.hovered = name;
    this.style();
  }

  /** Make the cords thinner by a factor, as for drawing. */
  setThinning(factor: number): void {
    this.thinning = factor;
    for (const entry of this.entries.values()) this.shape(entry);
    this.style();
  }

  setTheme(colors: SceneColors): void {
    this.colors = colors;
    this.style();
  }

  setViewport(width: number, height: number): void {
    for (const { outline } of this.entries.values()) viewport(outline).set(width, height);
    this.size = [width, height];
  }

  dispose(): void {
    for (const name of [...this.entries.keys()]) this.remove(name);
  }

  private add(cord: ShownCord): Entry {
    const tube = new Tube();
    const mesh = (pass: Parameters<typeof tubeMaterial>[0], order: number) => {
      const made = new Mesh(tube.geometry, tubeMaterial(pass));
      made.frustumCulled = false;
      made.renderOrder = order;
      this.object.add(made);
      return made;
    };
    const entry = {
      cord,
      tube,
      visible: mesh("visible", ORDER.cords),
      hidden: mesh("hidden", ORDER.hiddenCords),
      outline: mesh("outline", ORDER.outlines),
    };
    viewport(entry.outline).set(...this.size);
    this.entries.set(cord.name, entry);
    return entry;
  }

  private remove(name: string): void {
    const entry = this.entries.get(name)!;
    for (const mesh of [entry.visible, entry.hidden, entry.outline]) {
      this.object.remove(mesh);
      mesh.material.dispose();
    }
    entry.tube.geometry.dispose();
    this.entries.delete(name);
  }

  private shape({ cord, tube }: Entry): void {
    tube.set(cord.path, this.radius * this.thinning, this.broken);
  }

  private style(): void {
    if (!this.colors) return;
    for (const [name, { cord, visible, hidden, outline }] of this.entries) {
      const isSelected = this.selected.has(name);
      const isHovered = name === this.hovered;
      for (const mesh of [visible, hidden]) {
        mesh.visible = cord.isVisible;
        color(mesh, "base").set(cord.color);
        color(mesh, "alarm").set(this.colors.broken);
        mesh.material.uniforms.stripe!.value = STRIPE_RADII * this.radius;
      }
      const isChosen = isSelected || isHovered;
      hidden.material.uniforms.opacity!.value = isChosen ? 1 : HIDDEN_OPACITY;
      hidden.material.stencilWrite = !isChosen;
      hidden.renderOrder = isChosen ? ORDER.chosenCords : ORDER.hiddenCords;
      outline.visible = cord.isVisible && isChosen;
      color(outline, "base").set(isSelected ? this.colors.outline : this.colors.hover);
      color(outline, "alarm").copy(color(outline, "base"));
      outline.material.uniforms.outline!.value = isSelected ? OUTLINE_PX : OUTLINE_PX - 1;
    }
    this.onChange();
  }
}

function color(mesh: Entry["visible"], name: string): Color {
  return mesh.material.uniforms[name]!.value as Color;
}

function viewport(mesh: Entry["visible"]): Vector2 {
  return mesh.material.uniforms.viewport!.value as Vector2;
}
