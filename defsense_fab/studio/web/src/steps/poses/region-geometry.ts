// Shapes of regions: which points they hold, how they are moved, and the lines that show them.
import { Vector3 } from "three";
import type { RegionState } from "../../protocol/messages";

export type RegionShape = Pick<RegionState, "shape" | "points" | "radius">;

/** Points are sent with 32 bits, and those on the boundary of a region belong to it. */
const TOLERANCE_MM = 1e-3;
const CIRCLE_POINTS = 48;

/** Which of the vertices (v, 3) a region holds. */
export function verticesInside(region: RegionShape, vertices: ArrayLike<number>): Uint8Array {
  const inside = new Uint8Array(vertices.length / 3);
  const test = containment(region);
  for (let v = 0; v < inside.length; v++) {
    if (test(vertices[3 * v]!, vertices[3 * v + 1]!, vertices[3 * v + 2]!)) inside[v] = 1;
  }
  return inside;
}

function containment(region: RegionShape): (x: number, y: number, z: number) => boolean {
  const { shape, radius } = region;
  const [a, b] = region.points as [number[], number[]];
  const [ax, ay, az] = a as [number, number, number];
  const eps = TOLERANCE_MM;
  if (shape === "sphere") {
    return (x, y, z) => Math.hypot(x - ax, y - ay, z - az) <= radius + eps;
  }
  const [bx, by, bz] = b as [number, number, number];
  if (shape === "box") {
    return (x, y, z) =>
      x >= ax - eps && x <= bx + eps && y >= ay - eps && y <= by + eps && z >= az - eps && z <= bz + eps;
  }
  if (shape === "half-space") {
    const length = Math.hypot(bx, by, bz) || 1;
    return (x, y, z) => ((x - ax) * bx + (y - ay) * by + (z - az) * bz) / length >= -eps;
  }
  const height = Math.hypot(bx - ax, by - ay, bz - az) || 1;
  const [ux, uy, uz] = [(bx - ax) / height, (by - ay) / height, (bz - az) / height];
  return (x, y, z) => {
    const along = (x - ax) * ux + (y - ay) * uy + (z - az) * uz;
    if (along < -eps || along > height + eps) return false;
    return Math.hypot(x - ax - along * ux, y - ay - along * uy, z - az - along * uz) <= radius + eps;
  };
}

/** A region moved by (3,) mm. */
export function shifted(region: RegionShape, by: readonly number[]): RegionShape {
  const isDirection = (index: number) => region.shape === "half-space" && index === 1;
  const points = region.points.map((point, index) =>
    isDirection(index) ? point : point.map((value, k) => value + by[k]!),
  );
  return { ...region, points };
}

/** The middle of a region's shape; of a half space its point. */
export function middle({ shape, points }: RegionShape): number[] {
  const [a, b] = points as [number[], number[]];
  return shape === "sphere" || shape === "half-space" ? a : a.map((value, k) => (value + b[k]!) / 2);
}

/** A part of a region's shape that can be dragged along a direction, at a place (3,). */
export interface ShapeGrip {
  name: string;
  at: number[];
  direction: number[];
  /** Return the region with the grip moved by a distance along its direction, mm. */
  drag: (distance: number) => RegionShape;
}

/** What can be dragged of a region's shape: the faces of a box, ends and radius. */
export function shapeGrips(region: RegionShape): ShapeGrip[] {
  const center = middle(region);
  const [a, b] = region.points as [number[], number[]];
  if (region.shape === "box") {
    return [0, 1, 2].flatMap((k) =>
      [0, 1].map((side) => {
        const at = center.map((value, i) => (i === k ? region.points[side]![k]! : value));
        const direction = unit(k, side === 0 ? -1 : 1);
        const drag = (distance: number) => {
          const other = region.points[1 - side]![k]!;
          const wanted = at[k]! + distance * direction[k]!;
          const value = side === 0 ? Math.min(wanted, other - 0.1) : Math.max(wanted, other + 0.1);
          const points = region.points.map((point, i) =>
            i === side ? point.map((v, j) => (j === k ? rounded(value) : v)) : point,
          );
          return { ...region, points };
        };
        return { name: `${side === 0 ? "Lowest" : "Highest"} ${"xyz"[k]}`, at, direction, drag };
      }),
    );
  }
  if (region.shape === "half-space") return [];
  const across =
    region.shape === "sphere" ? [0, 0, 1] : sideways(b.map((value, k) => value - a[k]!))[0];
  const radius: ShapeGrip = {
    name: "Radius",
    at: center.map((value, k) => value + region.radius * across[k]!),
    direction: across,
    drag: (distance) => ({ ...region, radius: Math.max(0.1, rounded(region.radius + distance)) }),
  };
  if (region.shape === "sphere") return [radius];
  const axis = b.map((value, k) => value - a[k]!);
  const length = Math.hypot(...axis) || 1;
  const along = axis.map((value) => value / length);
  const ends = [0, 1].map((end): ShapeGrip => {
    const direction = along.map((value) => (end === 0 ? -value : value));
    const drag = (distance: number) => {
      const free = Math.max(distance, 0.1 - length);
      const points = region.points.map((point, i) =>
        i === end ? point.map((v, k) => rounded(v + free * direction[k]!)) : point,
      );
      return { ...region, points };
    };
    return { name: end === 0 ? "Start" : "End", at: region.points[end]!, direction, drag };
  });
  return [...ends, radius];
}

/** Lines (n, 2, 3) that show a region; a half space is as large as the body. */
export function outline(region: RegionShape, size: number): Float32Array {
  const [a, b] = region.points as [number[], number[]];
  const lines: number[] = [];
  if (region.shape === "box") {
    const corner = (i: number) => [0, 1, 2].map((k) => ((i >> k) & 1 ? b[k]! : a[k]!));
    for (let i = 0; i < 8; i++) {
      for (let k = 0; k < 3; k++) if (!((i >> k) & 1)) lines.push(...corner(i), ...corner(i | (1 << k)));
    }
  } else if (region.shape === "sphere") {
    for (let k = 0; k < 3; k++) {
      const [u, v] = sideways(unit(k, 1));
      lines.push(...circle(a, u, v, region.radius));
    }
  } else if (region.shape === "cylinder") {
    const [u, v] = sideways(b.map((value, k) => value - a[k]!));
    lines.push(...circle(a, u, v, region.radius), ...circle(b, u, v, region.radius));
    for (const [s, t] of [[1, 0], [0, 1], [-1, 0], [0, -1]] as const) {
      const side = u.map((value, k) => region.radius * (s * value + t * v[k]!));
      lines.push(...a.map((x, k) => x + side[k]!), ...b.map((x, k) => x + side[k]!));
    }
  } else {
    const [u, v] = sideways(b);
    const half = 0.3 * size;
    const normal = new Vector3().fromArray(b).normalize().toArray();
    const at = (s: number, t: number) => a.map((x, k) => x + half * (s * u[k]! + t * v[k]!));
    const corners = [at(-1, -1), at(1, -1), at(1, 1), at(-1, 1)];
    corners.forEach((point, i) => lines.push(...point, ...corners[(i + 1) % 4]!));
    for (const point of corners) lines.push(...point, ...point.map((x, k) => x + 0.2 * half * normal[k]!));
  }
  return new Float32Array(lines);
}

function circle(center: number[], u: number[], v: number[], radius: number): number[] {
  const at = (i: number) => {
    const angle = (2 * Math.PI * i) / CIRCLE_POINTS;
    return center.map(
      (x, k) => x + radius * (Math.cos(angle) * u[k]! + Math.sin(angle) * v[k]!),
    );
  };
  return Array.from({ length: CIRCLE_POINTS }, (_, i) => [...at(i), ...at(i + 1)]).flat();
}

/** Two unit vectors across a direction. */
function sideways(direction: number[]): [number[], number[]] {
  const axis = new Vector3().fromArray(direction).normalize();
  const smallest = axis.toArray().map(Math.abs);
  const least = smallest.indexOf(Math.min(...smallest));
  const u = axis.clone().cross(new Vector3().fromArray(unit(least, 1))).normalize();
  return [u.toArray(), axis.cross(u).toArray()];
}

function unit(index: number, length: number): number[] {
  return [0, 1, 2].map((k) => (k === index ? length : 0));
}

const rounded = (value: number): number => Math.round(value * 10) / 10;
