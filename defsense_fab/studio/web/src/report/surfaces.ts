// The surfaces of the view: the parts, the simulated body in a pose, and its predicted surface.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  Group,
  LineBasicMaterial,
  LineSegments,
  Vector3,
} from "three";
import { BodyLayer } from "../scene/body-layer";
import type { SceneColors } from "../scene/theme";
import { colorTable, type Quantity, tablePlace } from "./color-maps";
import type { Contents, Fact, PartRecord } from "./content";
import { blend } from "./interpolation";
import { featureEdges, meshEdges } from "./mesh-edges";
import { unpackFaces, unpackPoints } from "./packed-arrays";

/** Share of the body's color in that of a part, so that cords stand out. */
const PALENESS = 0.45;
/** Share of the selection's color in that of a selected part. */
const MARK_SHARE = 0.4;
const TRANSPARENT_OPACITY = 0.3;
const PREDICTED_COLOR = "#ff9f1c";

export type Prediction = "hidden" | "over" | "next";

function createLayer(
  vertices: Float32Array,
  faces: Uint32Array,
  edges = featureEdges(vertices, faces),
): BodyLayer {
  const ignore = () => {}; // the view draws after each change of its state
  const layer = new BodyLayer(ignore, ignore);
  layer.set({ vertices, faces, edges });
  return layer;
}

/** A printed part. */
export class Part {
  readonly kind = "part";
  private readonly layer: BodyLayer;
  private readonly directions: Vector3[];

  constructor(
    readonly record: PartRecord,
    index: number,
    { content, arrays }: Contents,
  ) {
    const [vertices] = unpackPoints(arrays[record.places]!, content.step);
    this.layer = createLayer(vertices!, unpackFaces(arrays[record.faces]!));
    this.directions = content.joints.map(({ ways }) => new Vector3(...ways[index]!));
  }

  get object(): Group {
    return this.layer.object;
  }

  /** Move the part as far as each joint is open, from 0 to 1. */
  open(shares: number[]): void {
    this.object.position.set(0, 0, 0);
    shares.forEach((share, k) => this.object.position.addScaledVector(this.directions[k]!, share));
  }

  show(isVisible: boolean, isTransparent: boolean): void {
    this.layer.setVisible(isVisible);
    this.layer.setOpacity(isTransparent ? TRANSPARENT_OPACITY : 1);
  }

  style(colors: SceneColors, isMarked: boolean): void {
    const color = new Color(this.record.color).lerp(new Color(colors.body), PALENESS);
    if (isMarked) color.lerp(new Color(colors.outline), MARK_SHARE);
    this.layer.setTheme({ ...colors, body: `#${color.getHexString()}` });
  }

  /** Return the box around the part where it is. */
  get box(): BodyLayer["box"] {
    return this.layer.box.clone().translate(this.object.position);
  }

  /** Return the distance at which a ray hits the part. */
  intersect(origin: Vector3, direction: Vector3): number {
    const from = origin.clone().sub(this.object.position);
    return this.layer.intersect(from.toArray(), direction.toArray()).distance;
  }
}

/** The simulated body in a pose, and its surface as the device predicts it. */
export class PosedSurface {
  readonly kind = "surface";
  readonly record: { name: string; facts: Fact[] };
  readonly object = new Group();
  readonly rest: Float32Array;
  /** Vertices (n, 3) of both surfaces in the pose, mm. */
  readonly points: Float32Array;
  readonly predictedPoints: Float32Array;
  /** Values at the ends of the color scales, mm and 1. */
  readonly scaleTops: Record<Quantity, number>;
  private readonly moved: Float32Array[];
  private readonly missed: Float32Array[];
  private readonly strain: (ArrayLike<number> & Iterable<number>)[];
  private readonly errors: Float32Array;
  private readonly colors: Float32Array;
  private readonly tables = { error: colorTable("error"), strain: colorTable("strain") };
  private readonly body: BodyLayer;
  private readonly predicted: BodyLayer;
  private readonly wireMaterial = new LineBasicMaterial({ color: PREDICTED_COLOR });
  private readonly wires = new LineSegments(new BufferGeometry(), this.wireMaterial);

  constructor({ content, arrays }: Contents) {
    const { surface, states, step } = content;
    const faces = unpackFaces(arrays[surface.faces]!);
    const [rest] = unpackPoints(arrays[surface.places]!, step);
    this.rest = rest!;
    const n = this.rest.length / 3;
    this.record = { name: "body", facts: [["simulated surface", `${faces.length / 3} triangles`]] };
    this.moved = unpackPoints(arrays[surface.moved]!, step, states.length);
    this.missed = unpackPoints(arrays[surface.missed]!, surface.missed_step, states.length);
    const strain = arrays[surface.strain]!;
    this.strain = states.map((_, k) => strain.subarray(k * n, (k + 1) * n));
    this.scaleTops = { error: surface.top_error || 1e-9, strain: surface.top_strain };
    this.points = this.rest.slice();
    this.predictedPoints = this.rest.slice();
    this.errors = new Float32Array(3 * n);
    this.colors = new Float32Array(3 * n);
    const edges = featureEdges(this.rest, faces);
    this.body = createLayer(this.rest, faces, edges);
    this.predicted = createLayer(this.rest, faces, edges);
    this.wires.geometry.setAttribute("position", new BufferAttribute(this.predictedPoints, 3));
    this.wires.geometry.setIndex(new BufferAttribute(meshEdges(faces), 1));
    this.wires.frustumCulled = false;
    this.object.add(this.body.object, this.predicted.object, this.wires);
  }

  /** Blend the states with weights; color the simulated body, and move what shows the predicted. */
  pose(weights: number[], quantity: Quantity | "none", prediction: Prediction): void {
    blend(this.points, this.rest, this.moved, weights);
    blend(this.errors, null, this.missed, weights);
    for (let i = 0; i < this.points.length; i++) {
      this.predictedPoints[i] = this.points[i]! + this.errors[i]!;
    }
    this.body.deform(this.points);
    if (prediction === "next") this.predicted.deform(this.predictedPoints);
    this.wires.geometry.getAttribute("position").needsUpdate = true;
    if (quantity === "none") this.body.setColors(null);
    else this.body.setColors(this.colorsOf(quantity, weights));
  }

  show(isBodyVisible: boolean, prediction: Prediction, isTransparent: boolean): void {
    this.body.setVisible(isBodyVisible);
    this.body.setOpacity(isTransparent ? TRANSPARENT_OPACITY : 1);
    this.predicted.setVisible(prediction === "next");
    this.wires.visible = prediction === "over";
  }

  /** Place the predicted surface next to the body. */
  setOffset(offset: Vector3): void {
    this.predicted.object.position.copy(offset);
  }

  get offset(): Vector3 {
    return this.predicted.object.position;
  }

  style(colors: SceneColors): void {
    this.body.setTheme(colors);
    this.predicted.setTheme({ ...colors, body: PREDICTED_COLOR });
  }

  /** Return the root mean square error of the predicted surface, mm. */
  rmse(): number {
    const sum = this.errors.reduce((total, x) => total + x * x, 0);
    return Math.sqrt(sum / (this.errors.length / 3));
  }

  /** Return the box around the body's movement from rest to a pose. */
  reach(weights: number[]): BodyLayer["box"] {
    const posed = new Float32Array(this.rest.length);
    blend(posed, this.rest, this.moved, weights);
    const [first, second] = [this.rest, posed].map((points) =>
      this.body.box.clone().setFromArray(points),
    );
    return first!.union(second!);
  }

  /** Return the distance at which a ray hits the body. */
  intersect(origin: Vector3, direction: Vector3): number {
    return this.body.intersect(origin.toArray(), direction.toArray()).distance;
  }

  private colorsOf(quantity: Quantity, weights: number[]): Float32Array {
    const { colors, errors } = this;
    const table = this.tables[quantity];
    for (let i = 0; i < colors.length / 3; i++) {
      let share = 0;
      if (quantity === "error") {
        const error = Math.hypot(errors[3 * i]!, errors[3 * i + 1]!, errors[3 * i + 2]!);
        share = error / this.scaleTops.error;
      } else {
        for (let k = 0; k < weights.length; k++) share += (weights[k]! * this.strain[k]![i]!) / 255;
      }
      const from = tablePlace(share);
      for (let c = 0; c < 3; c++) colors[3 * i + c] = table[from + c]!;
    }
    return colors;
  }
}
