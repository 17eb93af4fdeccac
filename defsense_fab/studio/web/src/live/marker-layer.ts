// Markers as discs that face the viewer; those inside or behind the body shine through it.
import { CircleGeometry, Color, Group, InstancedMesh, Matrix4, MeshBasicMaterial } from "three";
import type { NumberArray } from "../protocol/connection";
import { ORDER } from "../scene/order";

const HIDDEN_OPACITY = 0.25;
const SIDES = { disc: 16, diamond: 4 } as const;
/**
 * Turns a marker to the viewer, and brings its depth in front of the skin that it sits on.
 *
 * Without a light a disc looks like a ball, of which it has a twentieth of the triangles.
 */
const PROJECTION = /* glsl */ `
  vec4 mvPosition = modelViewMatrix * instanceMatrix * vec4(0.0, 0.0, 0.0, 1.0);
  mvPosition.xy += instanceMatrix[0].x * transformed.xy;
  gl_Position = projectionMatrix * mvPosition;
  vec4 lifted = projectionMatrix * (mvPosition + vec4(0.0, 0.0, lift, 0.0));
  gl_Position.z = lifted.z * gl_Position.w / lifted.w;
`;

export class MarkerLayer {
  readonly object = new Group();
  private readonly geometry: CircleGeometry;
  private readonly materials = [
    new MeshBasicMaterial({ transparent: true, opacity: HIDDEN_OPACITY, depthTest: false }),
    new MeshBasicMaterial({ transparent: true }),
  ];
  private meshes: InstancedMesh[] = [];
  private readonly lift = { value: 1 };
  private readonly matrix = new Matrix4();
  private readonly shown = new Color();
  private size = 1;

  constructor(shape: keyof typeof SIDES) {
    this.geometry = new CircleGeometry(1, SIDES[shape]);
    for (const material of this.materials) {
      material.depthWrite = false;
      material.onBeforeCompile = (shader) => {
        shader.uniforms.lift = this.lift;
        shader.vertexShader = shader.vertexShader
          .replace("void main()", "uniform float lift;\nvoid main()")
          .replace("#include <project_vertex>", PROJECTION);
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
    const { matrix, shown } = this;
    matrix.makeScale(this.size, this.size, this.size);
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
