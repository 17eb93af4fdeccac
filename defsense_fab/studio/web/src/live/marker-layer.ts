// Markers as small balls; those inside or behind the body shine through it.
import {
  Color,
  Group,
  InstancedMesh,
  Matrix4,
  MeshBasicMaterial,
  OctahedronGeometry,
  SphereGeometry,
} from "three";
import type { NumberArray } from "../protocol/connection";
import { ORDER } from "../scene/order";

const HIDDEN_OPACITY = 0.25;
/** Brings the depth of a marker in front of the skin that it sits on; its place stays. */
const LIFT = /* glsl */ `
  vec4 lifted = projectionMatrix * (mvPosition + vec4(0.0, 0.0, lift, 0.0));
  gl_Position.z = lifted.z * gl_Position.w / lifted.w;
`;

export class MarkerLayer {
  readonly object = new Group();
  private readonly geometry: SphereGeometry | OctahedronGeometry;
  private readonly materials = [
    new MeshBasicMaterial({ transparent: true, opacity: HIDDEN_OPACITY, depthTest: false }),
    new MeshBasicMaterial({ transparent: true }),
  ];
  private meshes: InstancedMesh[] = [];
  private readonly lift = { value: 1 };
  private size = 1;

  constructor(shape: "ball" | "diamond") {
    this.geometry = shape === "ball" ? new SphereGeometry(1, 16, 12) : new OctahedronGeometry(1);
    for (const material of this.materials) {
      material.depthWrite = false;
      material.onBeforeCompile = (shader) => {
        shader.uniforms.lift = this.lift;
        shader.vertexShader = shader.vertexShader
          .replace("void main()", "uniform float lift;\nvoid main()")
          .replace("#include <project_vertex>", `#include <project_vertex>\n${LIFT}`);
      };
    }
  }

  /** Set the radius of the markers, mm. */
  setSize(size: number): void {
    this.size = size;
    this.lift.value = 1.5 * size;
  }

  /** Show markers at points (m, 3), mm, each with its color. */
  set(points: NumberArray, color: (index: number) => readonly [number, number, number]): void {
    const count = points.length / 3;
    if (this.meshes[0]?.count !== count) this.allocate(count);
    const matrix = new Matrix4().makeScale(this.size, this.size, this.size);
    const shown = new Color();
    for (let k = 0; k < count; k++) {
      matrix.setPosition(points[3 * k]!, points[3 * k + 1]!, points[3 * k + 2]!);
      const [red, green, blue] = color(k);
      shown.setRGB(red / 255, green / 255, blue / 255, "srgb");
      for (const mesh of this.meshes) {
        mesh.setMatrixAt(k, matrix);
        mesh.setColorAt(k, shown);
      }
    }
    for (const mesh of this.meshes) {
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }

  dispose(): void {
    this.clear();
    this.geometry.dispose();
    for (const material of this.materials) material.dispose();
  }

  private allocate(count: number): void {
    this.clear();
    if (count === 0) return;
    this.meshes = this.materials.map((material, pass) => {
      const mesh = new InstancedMesh(this.geometry, material, count);
      mesh.frustumCulled = false;
      mesh.renderOrder = ORDER.chosenCords + 1 + pass;
      return mesh;
    });
    this.object.add(...this.meshes);
  }

  private clear(): void {
    for (const mesh of this.meshes) {
      this.object.remove(mesh);
      mesh.dispose();
    }
    this.meshes = [];
  }
}
