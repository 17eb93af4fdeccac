// The body's triangles with normals that are smooth except across feature edges.

/** Triangles whose vertices are doubled along feature edges. */
export interface CreasedMesh {
  /** Vertex of the body of each vertex (n,). */
  source: Uint32Array;
  /** Triangles (f, 3) of these vertices. */
  faces: Uint32Array;
}

/** Split vertices so that no vertex has faces on both sides of a feature edge. */
export function creaseMesh(count: number, faces: Uint32Array, edges: Uint32Array): CreasedMesh {
  const sharp = new Set<number>();
  const isSharp = new Uint8Array(count);
  for (let e = 0; e < edges.length; e += 2) {
    const [a, b] = [edges[e]!, edges[e + 1]!];
    sharp.add(a < b ? a * count + b : b * count + a);
    isSharp[a] = isSharp[b] = 1;
  }
  const corners = new Map<number, number[]>();
  for (let c = 0; c < faces.length; c++) {
    const v = faces[c]!;
    if (!isSharp[v]) continue;
    const list = corners.get(v);
    if (list) list.push(c);
    else corners.set(v, [c]);
  }
  const split = new Uint32Array(faces);
  const added: number[] = [];
  for (const [vertex, around] of corners) {
    const group = groupCorners(vertex, around, faces, sharp, count);
    const ids = new Map<number, number>([[group[0]!, vertex]]);
    around.forEach((corner, i) => {
      let id = ids.get(group[i]!);
      if (id === undefined) {
        id = count + added.length;
        added.push(vertex);
        ids.set(group[i]!, id);
      }
      split[corner] = id;
    });
  }
  const source = new Uint32Array(count + added.length);
  for (let v = 0; v < count; v++) source[v] = v;
  source.set(added, count);
  return { source, faces: split };
}

/** Return a group number of each corner: those of faces joined by edges that are not sharp. */
function groupCorners(
  vertex: number,
  corners: number[],
  faces: Uint32Array,
  sharp: Set<number>,
  count: number,
): number[] {
  const group = corners.map((_, i) => i);
  const root = (i: number): number => (group[i] === i ? i : root(group[i]!));
  const firstWith = new Map<number, number>();
  corners.forEach((corner, i) => {
    const face = corner - (corner % 3);
    for (let k = 0; k < 3; k++) {
      const other = faces[face + k]!;
      if (other === vertex) continue;
      if (sharp.has(other < vertex ? other * count + vertex : vertex * count + other)) continue;
      const neighbor = firstWith.get(other);
      if (neighbor === undefined) firstWith.set(other, i);
      else group[root(i)] = root(neighbor);
    }
  });
  return group.map((_, i) => root(i));
}

/** Return the edges (e, 2) that are part of lines of at least a length; specks are left out. */
export function longEdges(
  vertices: Float32Array,
  edges: Uint32Array,
  smallest: number,
): Uint32Array {
  const parent = new Map<number, number>();
  const root = (v: number): number => {
    let top = v;
    for (let up = parent.get(top); up !== undefined && up !== top; up = parent.get(top)) top = up;
    parent.set(v, top);
    return top;
  };
  for (let e = 0; e < edges.length; e += 2) parent.set(root(edges[e]!), root(edges[e + 1]!));
  const lengths = new Map<number, number>();
  for (let e = 0; e < edges.length; e += 2) {
    const [a, b] = [3 * edges[e]!, 3 * edges[e + 1]!];
    const length = Math.hypot(
      vertices[a]! - vertices[b]!,
      vertices[a + 1]! - vertices[b + 1]!,
      vertices[a + 2]! - vertices[b + 2]!,
    );
    const line = root(edges[e]!);
    lengths.set(line, (lengths.get(line) ?? 0) + length);
  }
  return edges.filter((_, i) => lengths.get(root(edges[i - (i % 2)]!))! >= smallest);
}

/** Write area-weighted vertex normals; nothing is allocated. */
export function computeNormals(
  positions: Float32Array,
  faces: Uint32Array,
  normals: Float32Array,
): void {
  normals.fill(0);
  for (let f = 0; f < faces.length; f += 3) {
    const a = faces[f]! * 3;
    const b = faces[f + 1]! * 3;
    const c = faces[f + 2]! * 3;
    const ax = positions[a]!;
    const ay = positions[a + 1]!;
    const az = positions[a + 2]!;
    const ux = positions[b]! - ax;
    const uy = positions[b + 1]! - ay;
    const uz = positions[b + 2]! - az;
    const vx = positions[c]! - ax;
    const vy = positions[c + 1]! - ay;
    const vz = positions[c + 2]! - az;
    const nx = uy * vz - uz * vy;
    const ny = uz * vx - ux * vz;
    const nz = ux * vy - uy * vx;
    addTo(normals, a, nx, ny, nz);
    addTo(normals, b, nx, ny, nz);
    addTo(normals, c, nx, ny, nz);
  }
  for (let v = 0; v < normals.length; v += 3) {
    const x = normals[v]!;
    const y = normals[v + 1]!;
    const z = normals[v + 2]!;
    const scale = 1 / (Math.sqrt(x * x + y * y + z * z) || 1);
    normals[v] = x * scale;
    normals[v + 1] = y * scale;
    normals[v + 2] = z * scale;
  }
}

function addTo(values: Float32Array, at: number, x: number, y: number, z: number): void {
  values[at]! += x;
  values[at + 1]! += y;
  values[at + 2]! += z;
}
