// Rays against the body's triangles; fast enough for each click on 100,000 of them.

/** The first hit of a ray: the face and the distance; face -1 for none. */
export interface RayHit {
  face: number;
  distance: number;
}

/** Intersect a ray with triangles, seen from either side; nothing is allocated but the result. */
export function intersectRay(
  origin: ArrayLike<number>,
  direction: ArrayLike<number>,
  positions: Float32Array,
  faces: Uint32Array,
): RayHit {
  const [ox, oy, oz] = [origin[0]!, origin[1]!, origin[2]!];
  const [dx, dy, dz] = [direction[0]!, direction[1]!, direction[2]!];
  const hit = { face: -1, distance: Infinity };
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
    const px = dy * vz - dz * vy;
    const py = dz * vx - dx * vz;
    const pz = dx * vy - dy * vx;
    const det = ux * px + uy * py + uz * pz;
    if (det === 0) continue;
    const tx = ox - ax;
    const ty = oy - ay;
    const tz = oz - az;
    const s = (tx * px + ty * py + tz * pz) / det;
    if (s < 0 || s > 1) continue;
    const qx = ty * uz - tz * uy;
    const qy = tz * ux - tx * uz;
    const qz = tx * uy - ty * ux;
    const t = (dx * qx + dy * qy + dz * qz) / det;
    if (t < 0 || s + t > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / det;
    if (distance > 0 && distance < hit.distance) {
      hit.distance = distance;
      hit.face = f / 3;
    }
  }
  return hit;
}
