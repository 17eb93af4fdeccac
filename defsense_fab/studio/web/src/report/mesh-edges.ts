// The edges of a surface: all of them, or those that are drawn.

/** Angle between faces on both sides of a drawn edge, as in the studio. */
const EDGE_ANGLE_DEG = 25;
const SMALLEST_COSINE = Math.cos((EDGE_ANGLE_DEG * Math.PI) / 180);

/** Return the edges (e, 2) of triangles, each once. */
export function meshEdges(faces: Uint32Array): Uint32Array {
  return edgesAt(faces, pairCorners(faces), () => true);
}

/** Return the edges (e, 2) between faces that meet at an angle, and those of one face only. */
export function featureEdges(vertices: Float32Array, faces: Uint32Array): Uint32Array {
  const normals = faceNormals(vertices, faces);
  return edgesAt(faces, pairCorners(faces), (corner, other) => {
    if (other < 0) return true;
    const [a, b] = [corner - (corner % 3), other - (other % 3)];
    let cosine = 0;
    for (let k = 0; k < 3; k++) cosine += normals[a + k]! * normals[b + k]!;
    return cosine < SMALLEST_COSINE;
  });
}

/** Marks of corners whose edge is of one face only, or already the edge of another corner. */
const SINGLE = -1;
const REPEATED = -2;

/** Return for each corner, at which an edge starts, that of the same edge in the other face. */
function pairCorners(faces: Uint32Array): Int32Array {
  const count = faces.reduce((largest, vertex) => Math.max(largest, vertex), -1) + 1;
  const heads = new Int32Array(count).fill(-1);
  const next = new Int32Array(faces.length);
  const pairs = new Int32Array(faces.length).fill(SINGLE);
  for (let corner = 0; corner < faces.length; corner++) {
    const [a, b] = [faces[corner]!, faces[endOf(corner)]!];
    const low = Math.min(a, b);
    let other = heads[low]!;
    while (other >= 0 && faces[other]! + faces[endOf(other)]! !== a + b) other = next[other]!;
    if (other >= 0) {
      if (pairs[other] === SINGLE) pairs[other] = corner;
      pairs[corner] = REPEATED;
    } else {
      next[corner] = heads[low]!;
      heads[low] = corner;
    }
  }
  return pairs;
}

/** Return the edges (e, 2) that are included, by the corners of their faces. */
function edgesAt(
  faces: Uint32Array,
  pairs: Int32Array,
  isIncluded: (corner: number, other: number) => boolean,
): Uint32Array {
  const edges: number[] = [];
  for (let corner = 0; corner < faces.length; corner++) {
    const other = pairs[corner]!;
    if (other === REPEATED || !isIncluded(corner, other)) continue;
    edges.push(faces[corner]!, faces[endOf(corner)]!);
  }
  return Uint32Array.from(edges);
}

/** Return the corner at which the edge from a corner ends. */
function endOf(corner: number): number {
  return corner % 3 === 2 ? corner - 2 : corner + 1;
}

/** Return unit normals (f, 3). */
function faceNormals(vertices: Float32Array, faces: Uint32Array): Float32Array {
  const normals = new Float32Array(faces.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [3 * faces[f]!, 3 * faces[f + 1]!, 3 * faces[f + 2]!];
    const ux = vertices[b]! - vertices[a]!;
    const uy = vertices[b + 1]! - vertices[a + 1]!;
    const uz = vertices[b + 2]! - vertices[a + 2]!;
    const vx = vertices[c]! - vertices[a]!;
    const vy = vertices[c + 1]! - vertices[a + 1]!;
    const vz = vertices[c + 2]! - vertices[a + 2]!;
    normals[f] = uy * vz - uz * vy;
    normals[f + 1] = uz * vx - ux * vz;
    normals[f + 2] = ux * vy - uy * vx;
    const length = Math.hypot(normals[f]!, normals[f + 1]!, normals[f + 2]!) || 1;
    for (let k = 0; k < 3; k++) normals[f + k]! /= length;
  }
  return normals;
}
