// Read the packed arrays of the page, as PackedArrays in compact_data.py writes them.

const TYPES = { u1: Uint8Array, i2: Int16Array, u2: Uint16Array, u4: Uint32Array };

export type PackedNumbers = Uint8Array | Int16Array | Uint16Array | Uint32Array;
/** Type, first byte and number of values of an array. */
export type ArrayPlace = [type: keyof typeof TYPES, start: number, length: number];

/** Return the arrays of a text: deflated and base64-encoded. */
export async function unpackArrays(text: string, index: ArrayPlace[]): Promise<PackedNumbers[]> {
  const bytes = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(inflated).arrayBuffer();
  return index.map(([type, start, length]) => new TYPES[type](buffer, start, length));
}

/** Return the vertex numbers of triangles, from their zigzag differences. */
export function unpackFaces(steps: PackedNumbers): Uint32Array {
  const faces = new Uint32Array(steps.length);
  let at = 0;
  for (let i = 0; i < steps.length; i++) {
    at += (steps[i]! >>> 1) ^ -(steps[i]! & 1);
    faces[i] = at;
  }
  return faces;
}

/** Return `count` arrays of points (n, 3), mm, from the x, y and z of all of them. */
export function unpackPoints(numbers: PackedNumbers, step: number, count = 1): Float32Array[] {
  const n = numbers.length / 3 / count;
  return Array.from({ length: count }, (_, sheet) => {
    const points = new Float32Array(3 * n);
    for (let axis = 0; axis < 3; axis++) {
      const from = (axis * count + sheet) * n;
      for (let i = 0; i < n; i++) points[3 * i + axis] = step * numbers[from + i]!;
    }
    return points;
  });
}
