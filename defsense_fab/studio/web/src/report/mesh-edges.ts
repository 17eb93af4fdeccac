// The edges of a surface: all of them, or those that are drawn.

/** Angle between faces on both sides of a drawn edge, as in the studio. */
const EDGE_ANGLE_DEG = 25;
const SMALLEST_COSINE = Math.cos((EDGE_ANGLE_DEG * Math.PI) / 180);

/** Return the edges (e, 2) of triangles, each once. */
export function meshEdges(faces: Uint32Array): Uint32Array {
  const edges: number[] = [];
  for (const [, corner] of firstCorners(faces)) edges.push(...ends(faces, corner));
  return new Uint32Array(edges);
}

/** Return the edges (e, 2) between faces that meet at an angle, and those of one face only. */
export function featureEdges(vertices: Float32Array, faces: Uint32Array): Uint32Array {
  const normals = faceNormals(vertices, faces);
  const open = firstCorners(faces);
  const edges: number[] = [];
  for (let corner = 0; corner < faces.length; corner++) {
    const key = edgeKey(faces, corner);
    const first = open.get(key);
    if (first === undefined || first === corner) continue;
    open.delete(key);
    const [a, b] = [first - (first % 3), corner - (corner % 3)];
    const cosine =
      normals[a]! * normals[b]! +
      normals[a + 1]! * normals[b + 1]! +
      normals[a + 2]! * normals[b + 2]!;
    if (cosine < SMALLEST_COSINE) edges.push(...ends(faces, corner));
  }
  for (const [, corner] of open) edges.push(...ends(faces, corner));
  return new Uint32Array(edges);
}

/** Return for each edge the first corner of a face at which it starts. */
function firstCorners(faces: Uint32Array): Map<number, number> {
  const corners = new Map<number, number>();
  for (let corner = 0; corner < faces.length; corner++) {
    const key = edgeKey(faces, corner);
    if (!corners.has(key)) corners.set(key, corner);
  }
  return corners;
}

function edgeKey(faces: Uint32Array, corner: number): number {
  const [a, b] = ends(faces, corner);
  return a < b ? a * 2 ** 26 + b : b * 2 ** 26 + a;
}

function ends(faces: Uint32Array, corner: number): [number, number] {
  return [faces[corner]!, faces[corner % 3 === 2 ? corner - 2 : corner + 1]!];
}

/** Return unit normals (f, 3). */
function faceNormals(vertices: Float32Array, faces: Uint32Array): Float32Array {
  const normals = new Float32Array(faces.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [3 * faces[f]!, 3 * faces[f + 1]!, 3 * faces[f + 2]!];
    const [ux, uy, uz] = [0, 1, 2].map((k) => vertices[b + k]! - vertices[a + k]!);
    const [vx, vy, vz] = [0, 1, 2].map((k) => vertices[c + k]! - vertices[a + k]!);
    const normal = [uy! * vz! - uz! * vy!, uz! * vx! - ux! * vz!, ux! * vy! - uy! * vx!];
    const length = Math.hypot(...normal) || 1;
    for (let k = 0; k < 3; k++) normals[f + k] = normal[k]! / length;
  }
  return normals;
}
