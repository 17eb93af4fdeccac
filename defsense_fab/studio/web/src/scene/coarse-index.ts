// Fewer triangles on the same vertices, for slow machines while the picture moves.

const EDGE_FACTOR = 2.2;
/** Cells along an axis of the largest body; keys of cells are exact up to this number. */
const MAX_CELLS = 2 ** 16;

/**
 * Return triangles that join vertices in the same cell of a grid and with the same direction.
 *
 * The grid is a little coarser than the edges, so that about a quarter of the triangles remain.
 */
export function coarseIndex(
  positions: Float32Array,
  normals: Float32Array,
  faces: Uint32Array,
): Uint32Array {
  const cell = EDGE_FACTOR * meanEdge(positions, faces);
  const corner = [Infinity, Infinity, Infinity];
  for (let i = 0; i < positions.length; i++) corner[i % 3] = Math.min(corner[i % 3]!, positions[i]!);
  const representative = new Map<number, number>();
  const joined = new Uint32Array(positions.length / 3);
  for (let v = 0; v < joined.length; v++) {
    let key = side(normals, 3 * v);
    for (let k = 0; k < 3; k++) {
      key = key * MAX_CELLS + Math.floor((positions[3 * v + k]! - corner[k]!) / cell);
    }
    const known = representative.get(key);
    if (known === undefined) representative.set(key, v);
    joined[v] = known ?? v;
  }
  const kept: number[] = [];
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [joined[faces[f]!]!, joined[faces[f + 1]!]!, joined[faces[f + 2]!]!];
    if (a !== b && b !== c && c !== a) kept.push(a, b, c);
  }
  return new Uint32Array(kept);
}

/** Return which of the six directions along the axes a normal is nearest to. */
function side(normals: Float32Array, at: number): number {
  let [largest, axis] = [0, 0];
  for (let k = 0; k < 3; k++) {
    const value = normals[at + k]!;
    if (Math.abs(value) <= largest) continue;
    largest = Math.abs(value);
    axis = value < 0 ? k + 3 : k;
  }
  return axis;
}

function meanEdge(positions: Float32Array, faces: Uint32Array): number {
  let total = 0;
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b] = [faces[f]! * 3, faces[f + 1]! * 3];
    total += Math.hypot(
      positions[a]! - positions[b]!,
      positions[a + 1]! - positions[b + 1]!,
      positions[a + 2]! - positions[b + 2]!,
    );
  }
  return (3 * total) / faces.length;
}
