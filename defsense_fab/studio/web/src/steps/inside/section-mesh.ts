// The colored section, the direction in it, and the value at a ray.
import { BufferAttribute, BufferGeometry, Group, Mesh, type Ray, Vector3 } from "three";
import { intersectRay } from "../../scene/ray";
import type { ColorScale } from "./color-scale";
import { type PlaneUniforms, sectionMaterial, setScale } from "./materials";
import type { ProbedPoint, SectionData } from "./section-view";

const ORDER_SECTION = 2;
const BEHIND_CORDS = -1.5;

export class SectionMesh {
  readonly object = new Group();
  private readonly material: ReturnType<typeof sectionMaterial>;
  private readonly mesh: Mesh;
  private data: SectionData | null = null;

  constructor(uniforms: PlaneUniforms) {
    this.material = sectionMaterial(uniforms);
    this.mesh = new Mesh(new BufferGeometry(), this.material);
    this.mesh.renderOrder = ORDER_SECTION;
    this.mesh.frustumCulled = false;
    this.object.add(this.mesh);
  }

  /** Show a section, or none. */
  set(data: SectionData | null): void {
    this.data = data;
    this.object.visible = data !== null;
    if (!data) return;
    const { vertices, rest, triangles, values } = data;
    const count = values.length;
    const known = new Uint8Array(count);
    const numbers = new Float32Array(count);
    for (let i = 0; i < count; i++) {
      if (Number.isNaN(values[i]!)) continue;
      known[i] = 1;
      numbers[i] = values[i]!;
    }
    this.mesh.geometry.dispose();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(vertices, 3));
    geometry.setAttribute("rest", new BufferAttribute(rest, 3));
    geometry.setAttribute("value", new BufferAttribute(numbers, 1));
    geometry.setAttribute("known", new BufferAttribute(known, 1));
    geometry.setIndex(new BufferAttribute(triangles, 1));
    this.mesh.geometry = geometry;
  }

  /** Draw the section first, so that the cords of the scene stay visible on it. */
  drawBehindCords(): void {
    this.material.depthTest = this.material.depthWrite = false;
    this.mesh.renderOrder = BEHIND_CORDS;
  }

  setScale(scale: ColorScale): void {
    setScale(this.material, scale);
  }

  /** Set the color of unknown values (3,), 0 to 255, and how far a plane may leave its section. */
  setLook(unknown: readonly number[], reach: number): void {
    const [r, g, b] = unknown.map((c) => c / 255);
    (this.material.uniforms["unknown"]!.value as Vector3).set(r!, g!, b!);
    this.material.uniforms["reach"]!.value = reach;
  }

  /** Return the point of the section that a ray hits, with its value, or null. */
  probe(ray: Ray): ProbedPoint | null {
    if (!this.data) return null;
    const { vertices, rest, triangles, values } = this.data;
    const [origin, direction] = [ray.origin.toArray(), ray.direction.toArray()];
    const { face, distance } = intersectRay(origin, direction, vertices, triangles);
    if (face < 0) return null;
    const corners = [0, 1, 2].map((k) => triangles[3 * face + k]!);
    const shown = ray.at(distance, new Vector3());
    const weights = barycentric(shown, corners.map((v) => corner(vertices, v)));
    const mix = (of: (v: number) => number) =>
      corners.reduce((sum, v, k) => sum + weights[k]! * of(v), 0);
    return {
      value: mix((v) => values[v]!),
      rest: [0, 1, 2].map((axis) => mix((v) => rest[3 * v + axis]!)),
      shown: shown.toArray(),
    };
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.material.dispose();
    (this.material.uniforms["table"]!.value as { dispose(): void } | null)?.dispose();
  }
}

function corner(points: Float32Array, v: number): Vector3 {
  return new Vector3(points[3 * v], points[3 * v + 1], points[3 * v + 2]);
}

function barycentric(point: Vector3, [a, b, c]: Vector3[]): number[] {
  const normal = b!.clone().sub(a!).cross(c!.clone().sub(a!));
  const area = normal.lengthSq();
  const share = (p: Vector3, q: Vector3) =>
    p.clone().sub(point).cross(q.clone().sub(point)).dot(normal) / area;
  const [u, v] = [share(b!, c!), share(c!, a!)];
  return [u, v, 1 - u - v];
}
