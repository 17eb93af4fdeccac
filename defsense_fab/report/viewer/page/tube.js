// Tubes around lines of moving points, closed at their ends.
const SIDES = 10;

function tubeGeometry(count) {
  const rings = count + 2; // the ends once more, as flat caps
  const geometry = new THREE.BufferGeometry();
  for (const name of ["position", "normal"]) {
    geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * rings * SIDES), 3));
  }
  const faces = [];
  for (let r = 0; r < count - 1; r++) {
    for (let s = 0; s < SIDES; s++) {
      const a = r * SIDES + s, b = r * SIDES + (s + 1) % SIDES;
      faces.push(a, b, b + SIDES, a, b + SIDES, a + SIDES);
    }
  }
  for (let s = 1; s < SIDES - 1; s++) {
    const low = count * SIDES, high = low + SIDES;
    faces.push(low, low + s + 1, low + s, high, high + s, high + s + 1);
  }
  geometry.setIndex(faces);
  return geometry;
}

function layTube(geometry, points, radius) {
  const count = points.length / 3;
  const at = (i) => new THREE.Vector3().fromArray(points, 3 * i);
  const position = geometry.getAttribute("position"), normal = geometry.getAttribute("normal");
  const way = new THREE.Vector3(), across = new THREE.Vector3(), third = new THREE.Vector3();
  for (let i = 0; i < count; i++) {
    way.subVectors(at(Math.min(i + 1, count - 1)), at(Math.max(i - 1, 0))).normalize();
    if (i === 0) across.set(...(Math.abs(way.x) < 0.8 ? [1, 0, 0] : [0, 1, 0]));
    across.addScaledVector(way, -across.dot(way)).normalize();
    third.crossVectors(way, across);
    const middle = at(i);
    const rings = [[i, 0]];
    if (i === 0) rings.push([count, -1]);
    if (i === count - 1) rings.push([count + 1, 1]);
    for (let s = 0; s < SIDES; s++) {
      const angle = (2 * Math.PI * s) / SIDES;
      const out = across.clone().multiplyScalar(Math.cos(angle)).addScaledVector(third, Math.sin(angle));
      for (const [ring, end] of rings) {
        const k = ring * SIDES + s;
        position.setXYZ(k, middle.x + radius * out.x, middle.y + radius * out.y, middle.z + radius * out.z);
        if (end) normal.setXYZ(k, end * way.x, end * way.y, end * way.z);
        else normal.setXYZ(k, out.x, out.y, out.z);
      }
    }
  }
  position.needsUpdate = normal.needsUpdate = true;
  geometry.computeBoundingSphere();
  geometry.computeBoundingBox();
}
