// The cords, wires, pins and marker seats, which move along with parts.
import {
  AlwaysStencilFunc,
  BufferAttribute,
  BufferGeometry,
  type Color,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  ReplaceStencilOp,
  type ShaderMaterial,
  type Vector2,
  Vector3,
} from "three";
import { ORDER } from "../scene/order";
import { intersectRay } from "../scene/ray";
import { tubeMaterial } from "../scene/shading";
import type { SceneColors } from "../scene/theme";
import { Tube } from "../scene/tube";
import type { Contents, FollowerKind, FollowerRecord } from "./content";
import { blend } from "./interpolation";
import { unpackPoints } from "./packed-arrays";

/** Colors of the kinds that have no colors of their own. */
export const KIND_COLORS = { cord: null, wire: "#c1121f", pin: "#e8dcb0", seat: "#f8f9fa" };
const HIDDEN_OPACITY = 0.78;
const OUTLINE_PX = 2.5;
/** A seat is lifted above its flat by these shares of the device's size, so that it is visible. */
const OPENED_LIFT = 0.006;
const POSED_LIFT = 0.02; // the simulated surface has no flats

interface Shape {
  readonly object: Group;
  /** Follow points (p, 3); seats are lifted above them by `lift` mm. */
  set(points: Float32Array, lift: number): void;
  style(colors: SceneColors, isMarked: boolean): void;
  setViewport(width: number, height: number): void;
  intersect(origin: Vector3, direction: Vector3): number;
}

/** A cord, wire, pin or marker seat. */
export class Follower {
  readonly kind: FollowerKind;
  private readonly shape: Shape;
  private readonly rest: Float32Array;
  private readonly opened: Float32Array[];
  private readonly moved: Float32Array[];
  private readonly points: Float32Array;
  private readonly size: number;

  constructor(
    readonly record: FollowerRecord,
    { content, arrays }: Contents,
  ) {
    const unpack = (place: number, count: number) =>
      unpackPoints(arrays[place]!, content.step, count);
    this.kind = record.kind;
    this.size = content.size;
    this.rest = unpack(record.places, 1)[0]!;
    this.opened = unpack(record.opened, content.joints.length);
    this.moved = unpack(record.moved, content.states.length);
    this.points = this.rest.slice();
    const color = record.color ?? KIND_COLORS[record.kind] ?? "#000000";
    this.shape = record.radius
      ? new TubeShape(color, record.radius, record.kind === "cord")
      : new SeatShape(color);
  }

  get object(): Group {
    return this.shape.object;
  }

  /** Move as far as each joint is open, from 0 to 1. */
  open(shares: number[]): void {
    blend(this.points, this.rest, this.opened, shares);
    this.shape.set(this.points, OPENED_LIFT * this.size);
  }

  /** Move as the states with weights. */
  pose(weights: number[]): void {
    blend(this.points, this.rest, this.moved, weights);
    this.shape.set(this.points, POSED_LIFT * this.size);
  }

  style(colors: SceneColors, isMarked: boolean): void {
    this.shape.style(colors, isMarked);
  }

  setViewport(width: number, height: number): void {
    this.shape.setViewport(width, height);
  }

  /** Return the distance at which a ray hits the follower. */
  intersect(origin: Vector3, direction: Vector3): number {
    return this.object.visible ? this.shape.intersect(origin, direction) : Infinity;
  }
}

/** A tube; cords shine through the body. */
class TubeShape implements Shape {
  readonly object = new Group();
  private readonly tube = new Tube();
  private readonly visible: Mesh<BufferGeometry, ShaderMaterial>;
  private readonly hidden: Mesh<BufferGeometry, ShaderMaterial> | null;
  private readonly outline: Mesh<BufferGeometry, ShaderMaterial>;

  constructor(
    color: string,
    private readonly radius: number,
    isSeenThrough: boolean,
  ) {
    this.visible = this.addPass("visible", ORDER.cords);
    this.hidden = isSeenThrough ? this.addPass("hidden", ORDER.hiddenCords) : null;
    this.outline = this.addPass("outline", ORDER.outlines);
    for (const mesh of [this.visible, this.hidden]) if (mesh) base(mesh).set(color);
  }

  set(points: Float32Array): void {
    const path = Array.from({ length: points.length / 3 }, (_, i) =>
      Array.from(points.subarray(3 * i, 3 * i + 3)),
    );
    this.tube.set(path, this.radius, []);
  }

  style(colors: SceneColors, isMarked: boolean): void {
    this.outline.visible = isMarked;
    base(this.outline).set(colors.outline);
    this.outline.material.uniforms.outline!.value = OUTLINE_PX;
    if (!this.hidden) return;
    this.hidden.material.uniforms.opacity!.value = isMarked ? 1 : HIDDEN_OPACITY;
    this.hidden.material.stencilWrite = !isMarked;
    this.hidden.renderOrder = isMarked ? ORDER.chosenCords : ORDER.hiddenCords;
  }

  setViewport(width: number, height: number): void {
    (this.outline.material.uniforms.viewport!.value as Vector2).set(width, height);
  }

  intersect(origin: Vector3, direction: Vector3): number {
    const { geometry } = this.tube;
    const faces = Uint32Array.from(geometry.index!.array).subarray(0, geometry.drawRange.count);
    const positions = geometry.getAttribute("position").array as Float32Array;
    return intersectRay(origin.toArray(), direction.toArray(), positions, faces).distance;
  }

  private addPass(pass: Parameters<typeof tubeMaterial>[0], order: number): typeof this.visible {
    const mesh = new Mesh(this.tube.geometry, tubeMaterial(pass));
    mesh.frustumCulled = false;
    mesh.renderOrder = order;
    this.object.add(mesh);
    return mesh;
  }
}

/** The square of a marker; cords do not shine through it. */
class SeatShape implements Shape {
  readonly object = new Group();
  private readonly faces = new Uint32Array([0, 1, 2, 0, 2, 3]);
  private readonly corners = new Float32Array(12);
  private readonly geometry = new BufferGeometry();
  private readonly material: MeshBasicMaterial;

  constructor(private readonly color: string) {
    this.material = new MeshBasicMaterial({
      side: DoubleSide,
      stencilWrite: true,
      stencilFunc: AlwaysStencilFunc,
      stencilRef: 0,
      stencilZPass: ReplaceStencilOp,
    });
    this.geometry.setAttribute("position", new BufferAttribute(this.corners, 3));
    this.geometry.setIndex(new BufferAttribute(this.faces, 1));
    const mesh = new Mesh(this.geometry, this.material);
    mesh.frustumCulled = false;
    mesh.renderOrder = ORDER.body + 0.5;
    this.object.add(mesh);
  }

  set(points: Float32Array, lift: number): void {
    const [a, b, c] = [0, 3, 6].map((k) => new Vector3().fromArray(points, k));
    const up = b!.clone().sub(a!).cross(c!.sub(b!)).setLength(lift);
    for (let k = 0; k < 12; k++) this.corners[k] = points[k]! + up.getComponent(k % 3);
    this.geometry.getAttribute("position").needsUpdate = true;
  }

  style(colors: SceneColors, isMarked: boolean): void {
    this.material.color.set(isMarked ? colors.outline : this.color);
  }

  setViewport(): void {
    // Seats have no outline.
  }

  intersect(origin: Vector3, direction: Vector3): number {
    return intersectRay(origin.toArray(), direction.toArray(), this.corners, this.faces).distance;
  }
}

function base(mesh: Mesh<BufferGeometry, ShaderMaterial>): Color {
  return mesh.material.uniforms.base!.value as Color;
}
