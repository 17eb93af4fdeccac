// The body that a plane cuts: skin, edges and the outline of the cut follow the plane at once.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
} from "three";
import { computeNormals, creaseMesh } from "../../scene/body-geometry";
import type { SceneColors } from "../../scene/theme";
import type { Frame } from "../../scene/types";
import { edgeMaterial, type PlaneUniforms, skinMaterial } from "./materials";
import { heightAbove } from "./plane";
import type { BodyShape, Skin } from "./shapes";

const ORDER = { skin: 0, edges: 3, outline: 4 } as const;

export class CutBody {
  readonly object = new Group();
  private readonly skinMaterial: ReturnType<typeof skinMaterial>;
  private readonly edgeMaterial: ReturnType<typeof edgeMaterial>;
  private readonly outlineMaterial = new LineBasicMaterial();
  private readonly mesh: Mesh;
  private readonly edges: LineSegments;
  private readonly outline: LineSegments;
  private skin: Skin | null = null;
  private shape: BodyShape | null = null;
  private plane: Frame | null = null;
  private source: Uint32Array = new Uint32Array();
  private heights = new Float32Array();

  constructor(uniforms: PlaneUniforms) {
    this.skinMaterial = skinMaterial(uniforms);
    this.edgeMaterial = edgeMaterial(uniforms);
    this.mesh = new Mesh(new BufferGeometry(), this.skinMaterial);
    this.edges = new LineSegments(new BufferGeometry(), this.edgeMaterial);
    this.outline = new LineSegments(new BufferGeometry(), this.outlineMaterial);
    this.object.add(this.mesh, this.edges, this.outline);
    this.mesh.renderOrder = ORDER.skin;
    this.edges.renderOrder = ORDER.edges;
    this.outline.renderOrder = ORDER.outline;
    for (const child of this.object.children) child.frustumCulled = false;
  }

  /** Show a shape of the body, or nothing. */
  setShape(shape: BodyShape | null): void {
    this.object.visible = shape !== null;
    this.shape = shape;
    if (!shape) return;
    if (shape.skin !== this.skin) this.setSkin(shape.skin);
    const positions = attribute(this.mesh, "position");
    const target = positions.array as Float32Array;
    copyRows(shape.vertices, this.source, target);
    const normals = attribute(this.mesh, "normal");
    const index = this.mesh.geometry.index!.array as Uint32Array;
    computeNormals(target, index, normals.array as Float32Array);
    const lines = attribute(this.edges, "position");
    (lines.array as Float32Array).set(shape.vertices);
    positions.needsUpdate = normals.needsUpdate = lines.needsUpdate = true;
    this.updateOutline();
  }

  /** Cut along another plane. */
  setPlane(plane: Frame): void {
    this.plane = plane;
    this.updateOutline();
  }

  setTheme(colors: SceneColors): void {
    (this.skinMaterial.uniforms["base"]!.value as Color).set(colors.body);
    (this.skinMaterial.uniforms["cap"]!.value as Color).set(colors.edge).lerp(WHITE, 0.35);
    (this.edgeMaterial.uniforms["base"]!.value as Color).set(colors.edge);
    this.outlineMaterial.color.set(colors.outline);
  }

  dispose(): void {
    for (const part of [this.mesh, this.edges, this.outline]) part.geometry.dispose();
    for (const part of [this.skinMaterial, this.edgeMaterial, this.outlineMaterial]) part.dispose();
  }

  private setSkin(skin: Skin): void {
    this.skin = skin;
    const count = skin.rest.length / 3;
    const { source, faces } = creaseMesh(count, skin.faces, skin.edges);
    this.source = source;
    this.heights = new Float32Array(count);
    const size = 3 * source.length;
    const rest = new Float32Array(size);
    copyRows(skin.rest, source, rest);
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry({
      position: new Float32Array(size),
      normal: new Float32Array(size),
      rest,
    });
    this.mesh.geometry.setIndex(new BufferAttribute(faces, 1));
    this.edges.geometry.dispose();
    this.edges.geometry = geometry({ position: skin.rest.slice(), rest: skin.rest });
    this.edges.geometry.setIndex(new BufferAttribute(skin.edges, 1));
  }

  /** Draw the line in which the plane cuts the skin. */
  private updateOutline(): void {
    const { skin, shape, plane, heights } = this;
    if (!skin || !shape || !plane) return;
    for (let v = 0; v < heights.length; v++) heights[v] = heightAbove(plane, skin.rest, 3 * v);
    const points: number[] = [];
    const { faces } = skin;
    for (let f = 0; f < faces.length; f += 3) {
      for (let k = 0; k < 3; k++) {
        const [a, b] = [faces[f + k]!, faces[f + ((k + 1) % 3)]!];
        const [p, q] = [heights[a]!, heights[b]!];
        if (p > 0 === q > 0) continue;
        const share = p / (p - q);
        for (let axis = 0; axis < 3; axis++) {
          const from = shape.vertices[3 * a + axis]!;
          points.push(from + share * (shape.vertices[3 * b + axis]! - from));
        }
      }
    }
    this.outline.geometry.dispose();
    this.outline.geometry = geometry({ position: new Float32Array(points) });
  }
}

const WHITE = new Color(1, 1, 1);

function attribute(object: { geometry: BufferGeometry }, name: string): BufferAttribute {
  return object.geometry.getAttribute(name) as BufferAttribute;
}

function geometry(attributes: Record<string, Float32Array>): BufferGeometry {
  const made = new BufferGeometry();
  for (const [name, values] of Object.entries(attributes)) {
    made.setAttribute(name, new BufferAttribute(values, 3).setUsage(DynamicDrawUsage));
  }
  return made;
}

function copyRows(from: Float32Array, rows: Uint32Array, to: Float32Array): void {
  for (let i = 0; i < rows.length; i++) {
    for (let k = 0; k < 3; k++) to[3 * i + k] = from[3 * rows[i]! + k]!;
  }
}
