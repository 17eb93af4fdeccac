// The faces of regions in their colors, over the body or with it.
import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  type Color,
  Group,
  Mesh,
  type ShaderMaterial,
  Vector3,
} from "three";
import type { NumberArray } from "../../protocol/connection";
import { computeNormals, creaseMesh } from "../../scene/body-geometry";
import { ORDER } from "../../scene/order";
import { bodyMaterial, gridSpacing, setGrid } from "../../scene/shading";

export interface ColoredRegion {
  color: string;
  /** Which vertices (v,) of the body it holds. */
  inside: Uint8Array;
}

const BODY = -1;

export class PosedBody {
  readonly object = new Group();
  private positions = new BufferAttribute(new Float32Array(), 3);
  private normals = new BufferAttribute(new Float32Array(), 3);
  private rest = new BufferAttribute(new Float32Array(), 3);
  private spacing = 0;
  private source: Uint32Array = new Uint32Array();
  private faces: Uint32Array = new Uint32Array();
  private original: Uint32Array = new Uint32Array();
  private meshes: Mesh<BufferGeometry, ShaderMaterial>[] = [];
  private regions: ColoredRegion[] = [];

  /** Without a color of the body only its regions are drawn. */
  constructor(private bodyColor: string | null) {}

  /** Take a body: vertices (v, 3), faces (f, 3) and feature edges (e, 2). */
  set(arrays: Record<string, NumberArray>): void {
    const vertices = arrays["vertices"] as Float32Array;
    this.original = new Uint32Array(arrays["faces"]!);
    const creased = creaseMesh(vertices.length / 3, this.original, new Uint32Array(arrays["edges"] ?? []));
    this.source = creased.source;
    this.faces = creased.faces;
    const size = 3 * creased.source.length;
    this.positions = new BufferAttribute(new Float32Array(size), 3);
    this.normals = new BufferAttribute(new Float32Array(size), 3);
    this.deform(vertices);
    this.rest = this.positions.clone();
    this.spacing = gridSpacing(new Box3().setFromArray(vertices).getSize(new Vector3()).length());
    this.color(this.regions);
  }

  /** Move the vertices (v, 3). */
  deform(vertices: ArrayLike<number>): void {
    const target = this.positions.array as Float32Array;
    for (let i = 0; i < this.source.length; i++) {
      const from = 3 * this.source[i]!;
      target[3 * i] = vertices[from]!;
      target[3 * i + 1] = vertices[from + 1]!;
      target[3 * i + 2] = vertices[from + 2]!;
    }
    computeNormals(target, this.faces, this.normals.array as Float32Array);
    this.positions.needsUpdate = this.normals.needsUpdate = true;
  }

  /** Color regions; a face in two of them has the color of the first. */
  color(regions: ColoredRegion[]): void {
    this.regions = regions;
    this.clear();
    const parts = new Map<number, number[]>();
    for (let f = 0; f < this.original.length; f += 3) {
      const [a, b, c] = [this.original[f]!, this.original[f + 1]!, this.original[f + 2]!];
      const owner = regions.findIndex(({ inside }) => inside[a] && inside[b] && inside[c]);
      if (owner === BODY && this.bodyColor === null) continue;
      const part = parts.get(owner) ?? [];
      part.push(this.faces[f]!, this.faces[f + 1]!, this.faces[f + 2]!);
      parts.set(owner, part);
    }
    for (const [owner, part] of parts) {
      this.add(part, owner === BODY ? this.bodyColor! : regions[owner]!.color);
    }
  }

  setBodyColor(color: string): void {
    this.bodyColor = color;
    this.color(this.regions);
  }

  setVisible(isVisible: boolean): void {
    this.object.visible = isVisible;
  }

  dispose(): void {
    this.clear();
  }

  private add(index: number[], color: string): void {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.positions);
    geometry.setAttribute("normal", this.normals);
    geometry.setAttribute("rest", this.rest);
    geometry.setIndex(index);
    const material = bodyMaterial();
    setGrid(material, this.spacing);
    (material.uniforms["base"]!.value as Color).set(color);
    const mesh = new Mesh(geometry, material);
    mesh.renderOrder = ORDER.body + 0.5;
    mesh.frustumCulled = false;
    this.meshes.push(mesh);
    this.object.add(mesh);
  }

  private clear(): void {
    for (const mesh of this.meshes) {
      this.object.remove(mesh);
      mesh.geometry.dispose();
      mesh.material.dispose();
    }
    this.meshes = [];
  }
}
