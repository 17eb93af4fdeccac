// The triangles of a cord along its path, rebuilt in place while it is dragged.
import { BufferAttribute, BufferGeometry, DynamicDrawUsage } from "three";

const SIDES = 8;
/** Points of a path are left out while the path turns less than this, degrees. */
const LARGEST_TURN_DEG = 2.5;
const LARGEST_COSINE = Math.cos((LARGEST_TURN_DEG * Math.PI) / 180);
const ATTRIBUTES = [
  ["position", 3],
  ["normal", 3],
  ["along", 1],
  ["broken", 1],
] as const;
const CAP_INDICES = 6 * (SIDES - 2);

/** Parts of a path that are marked as broken lie within this many radii of a broken place. */
const BROKEN_REACH_RADII = 2;

export class Tube {
  readonly geometry = new BufferGeometry();
  private capacity = 0;

  get isEmpty(): boolean {
    return this.capacity === 0;
  }

  /** Follow points (p, 3) with a radius, mm; mark what is near the broken places (b, 3). */
  set(points: number[][], radius: number, broken: number[][]): void {
    const reach = (BROKEN_REACH_RADII * radius) ** 2;
    const marks = points.map((p) => (broken.some((b) => squared(b, p) < reach) ? 1 : 0));
    const kept = keptPoints(points, marks);
    const path = kept.map((i) => points[i]!);
    if (points.length > this.capacity) this.allocate(points.length);
    const position = this.values("position");
    const normal = this.values("normal");
    const along = this.values("along");
    const isBroken = this.values("broken");
    const [x, y, t] = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
    let length = 0;
    for (let i = 0; i < path.length; i++) {
      const p = path[i]!;
      direction(t, path[Math.max(0, i - 1)]!, path[Math.min(path.length - 1, i + 1)]!);
      if (i === 0) perpendicular(x, t);
      else {
        length += distance(p, path[i - 1]!);
        transport(x, t);
      }
      cross(y, t, x);
      for (let k = 0; k < SIDES; k++) {
        const angle = (2 * Math.PI * k) / SIDES;
        const [c, s] = [Math.cos(angle), Math.sin(angle)];
        const at = (i + 2) * SIDES + k;
        for (let axis = 0; axis < 3; axis++) {
          const n = c * x[axis]! + s * y[axis]!;
          normal[3 * at + axis] = n;
          position[3 * at + axis] = p[axis]! + radius * n;
        }
        // Stripes wind around the cord.
        along[at] = length + (radius * 2 * Math.min(k, SIDES - k)) / SIDES;
        isBroken[at] = marks[kept[i]!]!;
      }
    }
    const last = path.length - 1;
    this.closeEnd(0, 2, path[1]!, path[0]!);
    this.closeEnd(1, last + 2, path[last - 1]!, path[last]!);
    this.geometry.setDrawRange(0, CAP_INDICES + 6 * SIDES * last);
    for (const [name] of ATTRIBUTES) {
      this.geometry.getAttribute(name).needsUpdate = true;
    }
  }

  /** Copy a ring to an end; normals turn outward on both, so that outlines are closed there. */
  private closeEnd(to: number, from: number, inner: number[], outer: number[]): void {
    const position = this.values("position");
    const normal = this.values("normal");
    const n = [0, 0, 0];
    direction(n, inner, outer);
    for (let k = 0; k < SIDES; k++) {
      const [a, b] = [to * SIDES + k, from * SIDES + k];
      for (let axis = 0; axis < 3; axis++) {
        position[3 * a + axis] = position[3 * b + axis]!;
        normal[3 * b + axis] = (normal[3 * b + axis]! + n[axis]!) * Math.SQRT1_2;
        normal[3 * a + axis] = normal[3 * b + axis]!;
      }
      this.values("along")[a] = this.values("along")[b]!;
      this.values("broken")[a] = this.values("broken")[b]!;
    }
  }

  private values(name: string): Float32Array {
    return (this.geometry.getAttribute(name) as BufferAttribute).array as Float32Array;
  }

  private allocate(rings: number): void {
    this.capacity = rings;
    this.geometry.dispose();
    const count = (rings + 2) * SIDES;
    for (const [name, size] of ATTRIBUTES) {
      const attribute = new BufferAttribute(new Float32Array(size * count), size);
      this.geometry.setAttribute(name, attribute.setUsage(DynamicDrawUsage));
    }
    const index: number[] = [];
    for (let k = 1; k < SIDES - 1; k++) {
      index.push(0, k + 1, k, SIDES, SIDES + k, SIDES + k + 1);
    }
    for (let i = 2; i < rings + 1; i++) {
      for (let k = 0; k < SIDES; k++) {
        const [a, b] = [i * SIDES + k, i * SIDES + ((k + 1) % SIDES)];
        index.push(a, b, a + SIDES, b, b + SIDES, a + SIDES);
      }
    }
    this.geometry.setIndex(index);
  }
}

/** Return the points that a tube needs: where the path turns, and where marks change. */
function keptPoints(path: number[][], marks: number[]): number[] {
  const kept = [0];
  const [before, after] = [[0, 0, 0], [0, 0, 0]];
  direction(before, path[0]!, path[1]!);
  for (let i = 1; i < path.length - 1; i++) {
    direction(after, path[i]!, path[i + 1]!);
    const cosine = before[0]! * after[0]! + before[1]! * after[1]! + before[2]! * after[2]!;
    if (cosine > LARGEST_COSINE && marks[i] === marks[i - 1] && marks[i] === marks[i + 1]) continue;
    kept.push(i);
    [before[0], before[1], before[2]] = after;
  }
  kept.push(path.length - 1);
  return kept;
}

function direction(out: number[], from: number[], to: number[]): void {
  for (let k = 0; k < 3; k++) out[k] = to[k]! - from[k]!;
  normalize(out);
}

function normalize(v: number[]): void {
  const length = Math.hypot(v[0]!, v[1]!, v[2]!) || 1;
  for (let k = 0; k < 3; k++) v[k]! /= length;
}

function perpendicular(out: number[], t: number[]): void {
  const smallest = [0, 1, 2].sort((i, j) => Math.abs(t[i]!) - Math.abs(t[j]!))[0]!;
  for (let k = 0; k < 3; k++) out[k] = k === smallest ? 1 : 0;
  transport(out, t);
}

/** Turn a normal the least so that it is perpendicular to the next tangent. */
function transport(x: number[], t: number[]): void {
  const dot = x[0]! * t[0]! + x[1]! * t[1]! + x[2]! * t[2]!;
  for (let k = 0; k < 3; k++) x[k]! -= dot * t[k]!;
  normalize(x);
}

function cross(out: number[], a: number[], b: number[]): void {
  out[0] = a[1]! * b[2]! - a[2]! * b[1]!;
  out[1] = a[2]! * b[0]! - a[0]! * b[2]!;
  out[2] = a[0]! * b[1]! - a[1]! * b[0]!;
}

function squared(a: number[], b: number[]): number {
  return (a[0]! - b[0]!) ** 2 + (a[1]! - b[1]!) ** 2 + (a[2]! - b[2]!) ** 2;
}

function distance(a: number[], b: number[]): number {
  return Math.sqrt(squared(a, b));
}
