// The cords of a cut body: those behind the plane shine through the section, others are faint.
import { GreaterDepth, Group, Mesh, type ShaderMaterial, type Color } from "three";
import { tubeMaterial } from "../../scene/shading";
import { Tube } from "../../scene/tube";
import type { Frame } from "../../scene/types";
import { heightAbove } from "./plane";

/** A cord in the shown state and at rest, mm. */
export interface CutCord {
  color: string;
  path: number[][];
  rest: number[][];
}

const OPACITY = { solid: 1, hidden: 0.38, away: 0.22 } as const;
type Look = keyof typeof OPACITY;
const ORDER: Record<Look, number> = { solid: 1, hidden: 6, away: 7 };

export class CutCords {
  readonly object = new Group();
  private cords: readonly CutCord[] = [];
  private plane: Frame | null = null;
  private radius = 1;

  /** Show cords with a radius, mm. */
  set(cords: readonly CutCord[], radius: number): void {
    this.cords = cords;
    this.radius = radius;
    this.build();
  }

  setPlane(plane: Frame): void {
    this.plane = plane;
    this.build();
  }

  dispose(): void {
    this.clear();
  }

  private build(): void {
    this.clear();
    for (const cord of this.cords) {
      for (const { path, isAway } of pieces(cord, this.plane)) {
        const tube = new Tube();
        tube.set(path, this.radius, []);
        const looks: Look[] = isAway ? ["away"] : ["solid", "hidden"];
        for (const look of looks) this.object.add(this.mesh(tube, cord.color, look));
      }
    }
  }

  private mesh(tube: Tube, color: string, look: Look): Mesh {
    const material: ShaderMaterial = tubeMaterial("visible");
    (material.uniforms["base"]!.value as Color).set(color);
    material.uniforms["opacity"]!.value = OPACITY[look];
    material.transparent = look !== "solid";
    material.depthWrite = look === "solid";
    if (look === "hidden") material.depthFunc = GreaterDepth;
    const mesh = new Mesh(tube.geometry, material);
    mesh.renderOrder = ORDER[look];
    mesh.frustumCulled = false;
    return mesh;
  }

  private clear(): void {
    for (const child of [...this.object.children]) {
      const mesh = child as Mesh<Tube["geometry"], ShaderMaterial>;
      mesh.geometry.dispose();
      mesh.material.dispose();
      this.object.remove(mesh);
    }
  }
}

interface Piece {
  path: number[][];
  isAway: boolean;
}

/** Split a cord where it crosses the plane. */
function pieces({ path, rest }: CutCord, plane: Frame | null): Piece[] {
  if (!plane) return [{ path, isAway: false }];
  // What lies in the plane belongs to the half that is shown.
  const heights = rest.map((point) => heightAbove(plane, point) - 1e-3);
  const found: Piece[] = [{ path: [path[0]!], isAway: heights[0]! > 0 }];
  for (let i = 1; i < path.length; i++) {
    const [p, q] = [heights[i - 1]!, heights[i]!];
    if (p > 0 !== q > 0) {
      const share = p / (p - q);
      const crossing = path[i]!.map((v, k) => path[i - 1]![k]! + share * (v - path[i - 1]![k]!));
      found.at(-1)!.path.push(crossing);
      found.push({ path: [crossing], isAway: q > 0 });
    }
    found.at(-1)!.path.push(path[i]!);
  }
  return found.filter((piece) => piece.path.length > 1);
}
