// Read the packed arrays of the page, as PackedArrays in compact_data.py writes them.
const TYPES = { u1: Uint8Array, i2: Int16Array, u2: Uint16Array, u4: Uint32Array };

async function unpack(text, index) {
  const letters = atob(text.trim());
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(inflated).arrayBuffer();
  return index.map(([type, start, length]) => new TYPES[type](buffer, start, length));
}

// Vertex numbers of triangles, from their zigzag differences.
function facesOf(steps) {
  const faces = new Uint32Array(steps.length);
  let at = 0;
  for (let i = 0; i < steps.length; i++) {
    at += (steps[i] >>> 1) ^ -(steps[i] & 1);
    faces[i] = at;
  }
  return faces;
}

// Points x y z x y z ... in mm, from the n x, n y and n z of `sheet` 0, 1, ... of `count` sheets.
function pointsOf(numbers, step, count = 1, sheet = 0) {
  const n = numbers.length / 3 / count;
  const points = new Float32Array(3 * n);
  for (let axis = 0; axis < 3; axis++) {
    const from = (axis * count + sheet) * n;
    for (let i = 0; i < n; i++) points[3 * i + axis] = step * numbers[from + i];
  }
  return points;
}
