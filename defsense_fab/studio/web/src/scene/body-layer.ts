// The body: shaded triangles with feature edges; transparent on request.
import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  Vector3,
} from "three";
import type { NumberArray } from "../protocol/connection";
import { computeNormals, creaseMesh, longEdges } from "./body-geometry";
import { coarseIndex } from "./coarse-index";
import { ORDER } from "./order";
import { intersectRay, type RayHit } from "./ray";
import { bodyMaterial, gridSpacing, setGrid } from "./shading";
import type { SceneColors } from "./theme";

/** Bodies with fewer triangles are fast enough. */
const MIN_COARSENED_FACES = 30_000;
/** Length of the shortest line of edges that is drawn, as a share of the body's diagonal. */
const SMALLEST_LINE = 0.08;

export class BodyLayer {
  readonly object = new Group();
  readonly box = new Box3();
  private readonly material = bodyMaterial();
  private readonly depthMaterial = bodyMaterial();
  private readonly edgeMaterial = new LineBasicMaterial({ transparent: true, opacity: 0.75 });
  private readonly mesh = new Mesh(new BufferGeometry(), this.material);
  private readonly depthMesh = new Mesh(this.mesh.geometry, this.depthMaterial);
  private readonly lines = new LineSegments(new BufferGeometry(), this.edgeMaterial);
  private source: Uint32Array = new Uint32Array();
  private faces: Uint32Array = new Uint32Array();
  private vertices = new Float32Array();
  private fine = new BufferAttribute(new Uint32Array(), 1);
  private coarse: BufferAttribute | null = null;
  private colors: BufferAttribute | null = null;
  private opacity = 1;
  private dimming = 1;
  private hasGrid = false;
  private restSize = 1;

  constructor(
    private readonly onChange: () => void,
    private readonly onShape: () => void,
  ) {
    this.depthMaterial.colorWrite = false;
    this.depthMaterial.stencilWrite = false;
    this.depthMesh.renderOrder = ORDER.bodyDepth;
    this.lines.renderOrder = ORDER.edges;
    this.object.add(this.depthMesh, this.mesh, this.lines);
    for (const child of this.object.children) child.frustumCulled = false;
    this.applyOpacity();
  }

  get isEmpty(): boolean {
    return this.faces.length === 0;
  }

  /** Show a body: vertices (v, 3), faces (f, 3) and feature edges (e, 2). */
  set(arrays: Record<string, NumberArray>): void {
    const vertices = new Float32Array(arrays.vertices!);
    const faces = new Uint32Array(arrays.faces!);
    const edges = new Uint32Array(arrays.edges ?? []);
    const creased = creaseMesh(vertices.length / 3, faces, edges);
    this.source = creased.source;
    this.faces = faces;
    this.vertices = vertices;
    this.colors = null;
    this.mesh.geometry.dispose();
    this.lines.geometry.dispose();
    const geometry = new BufferGeometry();
    const count = 3 * creased.source.length;
    for (const name of ["position", "normal", "rest"]) {
      const attribute = new BufferAttribute(new Float32Array(count), 3);
      geometry.setAttribute(name, attribute.setUsage(DynamicDrawUsage));
    }
    this.fine = new BufferAttribute(creased.faces, 1);
    this.coarse = null;
    geometry.setIndex(this.fine);
    this.mesh.geometry = geometry;
    this.depthMesh.geometry = geometry;
    const lines = new BufferGeometry();
    lines.setAttribute("position", new BufferAttribute(vertices, 3));
    this.restSize = this.box.setFromArray(vertices).getSize(new Vector3()).length();
    const smallest = SMALLEST_LINE * this.restSize;
    lines.setIndex(new BufferAttribute(longEdges(vertices, edges, smallest), 1));
    this.lines.geometry = lines;
    this.setColors(null);
    this.deform(vertices);
    const rest = geometry.getAttribute("rest").array as Float32Array;
    rest.set(geometry.getAttribute("position").array);
    this.setGrid(this.hasGrid);
  }

  /** Show whether a round body turns, by lines of the body at rest. */
  setGrid(hasGrid: boolean): void {
    this.hasGrid = hasGrid;
    setGrid(this.material, hasGrid ? gridSpacing(this.restSize) : 0);
    this.onChange();
  }

  /** Move the vertices (v, 3) of the body in place. */
  deform(vertices: NumberArray): void {
    const positions = this.mesh.geometry.getAttribute("position") as BufferAttribute;
    const target = positions.array as Float32Array;
    for (let i = 0; i < this.source.length; i++) {
      const from = this.source[i]! * 3;
      target[3 * i] = vertices[from]!;
      target[3 * i + 1] = vertices[from + 1]!;
      target[3 * i + 2] = vertices[from + 2]!;
    }
    const normals = this.mesh.geometry.getAttribute("normal") as BufferAttribute;
    computeNormals(target, this.fine.array as Uint32Array, normals.array as Float32Array);
    positions.needsUpdate = normals.needsUpdate = true;
    if (vertices !== this.vertices) this.vertices.set(vertices);
    this.lines.geometry.getAttribute("position").needsUpdate = true;
    this.box.setFromArray(this.vertices);
    this.onShape();
  }

  /**
   * Color the vertices (v, 3) of the body, with values from 0 to 1 in sRGB; null for its own color.
   *
   * Exact colors are shown without shading, so that they can be compared with a legend.
   */
  setColors(colors: ArrayLike<number> | null, isExact = false): void {
    const { geometry } = this.mesh;
    if (this.material.vertexColors !== (colors !== null)) {
      this.material.vertexColors = colors !== null;
      this.material.needsUpdate = true;
    }
    this.material.uniforms.isExact!.value = isExact && colors !== null;
    if (colors) {
      this.colors ??= new BufferAttribute(new Float32Array(3 * this.source.length), 3);
      const color = new Color();
      for (let i = 0; i < this.source.length; i++) {
        const from = this.source[i]! * 3;
        color.setRGB(colors[from]!, colors[from + 1]!, colors[from + 2]!, "srgb");
        color.toArray(this.colors.array, 3 * i);
      }
      this.colors.needsUpdate = true;
      geometry.setAttribute("color", this.colors);
    } else geometry.deleteAttribute("color");
    this.onChange();
  }

  /** Show only its lines, in front of other bodies. */
  setLinesOnly(): void {
    this.setGrid(true);
    this.material.defines["HAS_ONLY_GRID"] = "";
    this.material.depthTest = this.material.depthWrite = this.edgeMaterial.depthTest = false;
    this.material.transparent = true;
    this.material.stencilWrite = this.depthMesh.visible = false;
    this.mesh.renderOrder = this.lines.renderOrder = ORDER.edges;
  }

  /** Set the opacity from 0 to 1; at 1 the cords shine through. */
  setOpacity(opacity: number): void {
    this.opacity = opacity;
    this.applyOpacity();
  }

  /** Dim the body by a factor, as for drawing in a plane. */
  setDimming(factor: number): void {
    this.dimming = factor;
    this.applyOpacity();
  }

  /** Show fewer triangles of a large body, or all. */
  setCoarse(isCoarse: boolean): void {
    const { geometry } = this.mesh;
    if (isCoarse && this.faces.length >= 3 * MIN_COARSENED_FACES) {
      this.coarse ??= new BufferAttribute(
        coarseIndex(
          geometry.getAttribute("position").array as Float32Array,
          geometry.getAttribute("normal").array as Float32Array,
          this.fine.array as Uint32Array,
        ),
        1,
      );
      geometry.setIndex(this.coarse);
    } else geometry.setIndex(this.fine);
  }

  setVisible(isVisible: boolean): void {
    this.object.visible = isVisible;
    this.onChange();
  }

  setTheme(colors: SceneColors): void {
    (this.material.uniforms.base!.value as Color).set(colors.body);
    this.edgeMaterial.color.set(colors.edge);
    this.onChange();
  }

  /** Return the first face that a ray hits. */
  intersect(origin: ArrayLike<number>, direction: ArrayLike<number>): RayHit {
    if (!this.object.visible) return { face: -1, distance: Infinity };
    return intersectRay(origin, direction, this.vertices, this.faces);
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.lines.geometry.dispose();
    for (const material of [this.material, this.depthMaterial, this.edgeMaterial]) {
      material.dispose();
    }
  }

  private applyOpacity(): void {
    const opacity = this.opacity * this.dimming;
    const isOpaque = opacity >= 1;
    this.material.uniforms.opacity!.value = opacity;
    this.material.transparent = !isOpaque;
    this.material.stencilWrite = isOpaque;
    this.mesh.renderOrder = isOpaque ? ORDER.body : ORDER.transparentBody;
    this.depthMesh.visible = !isOpaque;
    this.edgeMaterial.opacity = 0.75 * Math.min(1, 0.3 + opacity);
    this.onChange();
  }
}
