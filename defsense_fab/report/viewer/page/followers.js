// The parts, the things that move along with them, and the body's simulated surface.
const KIND_COLORS = { wire: "#c1121f", pin: "#e8dcb0", seat: "#f8f9fa" };

function meshOf(positions, faces, material) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  return new THREE.Mesh(geometry, material);
}

function solidOf(color, extra) {
  return new THREE.MeshLambertMaterial({ color, flatShading: true, ...extra });
}

// A paler color for a part, so that cords stand out.
function paler(color) {
  return "#" + new THREE.Color(color).lerp(new THREE.Color("#ffffff"), 0.12).getHexString();
}

class Part {
  constructor(record, k, scene) {
    const points = pointsOf(scene.arrays[record.places], scene.content.step);
    this.kind = "part";
    this.record = record;
    this.mesh = meshOf(points, facesOf(scene.arrays[record.faces]), solidOf(paler(record.color)));
    this.mesh.geometry.computeBoundingBox();
    this.ways = scene.content.joints.map((joint) => new THREE.Vector3(...joint.ways[k]));
  }

  // Move the part as far as each joint is open, from 0 to 1.
  open(shares) {
    this.mesh.position.set(0, 0, 0);
    shares.forEach((share, k) => this.mesh.position.addScaledVector(this.ways[k], share));
  }

  growBox(box) {
    const moved = this.mesh.geometry.boundingBox.clone().translate(this.mesh.position);
    box.union(moved);
  }
}

// A cord, wire, pin or marker seat.
class Follower {
  constructor(record, scene) {
    const { arrays } = scene, { step, joints, states } = scene.content;
    const sheets = (place, count) =>
      Array.from({ length: count }, (_, k) => pointsOf(arrays[place], step, count, k));
    this.kind = record.kind;
    this.record = record;
    this.rest = pointsOf(arrays[record.places], step);
    this.opened = sheets(record.opened, joints.length);
    this.moved = sheets(record.moved, states.length);
    this.now = this.rest.slice();
    const color = record.color || KIND_COLORS[record.kind];
    this.mesh = record.radius
      ? new THREE.Mesh(tubeGeometry(this.rest.length / 3), new THREE.MeshLambertMaterial({ color }))
      : meshOf(new Float32Array(12), new Uint32Array([0, 1, 2, 0, 2, 3]),
          solidOf(color, { side: THREE.DoubleSide }));
    this.size = scene.content.size;
    this._show(0);
  }

  open(shares) {
    blend(this.now, this.rest, this.opened, shares);
    this._show(0.006 * this.size);
  }

  pose(weights) {
    blend(this.now, this.rest, this.moved, weights);
    this._show(0.02 * this.size); // the simulated surface has no flats
  }

  // A seat is lifted by `lift` mm above its flat, so that it is visible.
  _show(lift) {
    const { geometry } = this.mesh;
    if (this.record.radius) return layTube(geometry, this.now, this.record.radius);
    const [a, b, c] = [0, 3, 6].map((k) => new THREE.Vector3().fromArray(this.now, k));
    const out = b.clone().sub(a).cross(c.sub(b)).setLength(lift);
    const position = geometry.getAttribute("position");
    for (let k = 0; k < this.now.length; k++) position.array[k] = this.now[k] + out.getComponent(k % 3);
    geometry.getAttribute("position").needsUpdate = true;
    geometry.computeBoundingSphere();
    geometry.computeBoundingBox();
  }
}

// The simulated surface in a pose, and the surface as the device reads it.
class Body {
  constructor(scene) {
    const { arrays } = scene, { step, states, surface } = scene.content;
    const sheets = (place, by) =>
      states.map((_, k) => pointsOf(arrays[place], by, states.length, k));
    const faces = facesOf(arrays[surface.faces]);
    this.kind = "surface";
    this.record = { name: "body", facts: [["simulated surface", faces.length / 3 + " triangles"]] };
    this.rest = pointsOf(arrays[surface.places], step);
    this.moved = sheets(surface.moved, step);
    this.missed = sheets(surface.missed, surface.missed_step);
    const n = this.rest.length / 3;
    this.strain = states.map((_, k) => arrays[surface.strain].subarray(k * n, (k + 1) * n));
    this.tops = { error: surface.top_error || 1e-9, strain: surface.top_strain };
    this.off = new Float32Array(3 * n);
    this.mesh = meshOf(new Float32Array(3 * n), faces, solidOf("#ffffff", { vertexColors: true }));
    this.read = meshOf(new Float32Array(3 * n), faces, solidOf("#ff9f1c"));
    const colors = new THREE.BufferAttribute(new Float32Array(3 * n), 3);
    this.mesh.geometry.setAttribute("color", colors);
    this.tables = { error: colorTable("error"), strain: colorTable("strain") };
  }

  pose(weights, quantity) {
    const now = this._points(this.mesh), read = this._points(this.read);
    blend(now, this.rest, this.moved, weights);
    blend(this.off, new Float32Array(this.off.length), this.missed, weights);
    for (let i = 0; i < now.length; i++) read[i] = now[i] + this.off[i];
    this._color(weights, quantity);
    for (const mesh of [this.mesh, this.read]) {
      mesh.geometry.getAttribute("position").needsUpdate = true;
      mesh.geometry.computeBoundingSphere();
      mesh.geometry.computeBoundingBox();
    }
  }

  _points(mesh) {
    return mesh.geometry.getAttribute("position").array;
  }

  _color(weights, quantity) {
    const attribute = this.mesh.geometry.getAttribute("color"), colors = attribute.array;
    const table = this.tables[quantity], off = this.off;
    const gray = new THREE.Color("#b9c7d1");
    for (let i = 0; i < colors.length / 3; i++) {
      if (!table) {
        gray.toArray(colors, 3 * i);
        continue;
      }
      let share = 0;
      if (quantity === "error") share = Math.hypot(off[3 * i], off[3 * i + 1], off[3 * i + 2]) / this.tops.error;
      else weights.forEach((w, k) => (share += (w * this.strain[k][i]) / 255));
      const at = 3 * Math.round(255 * Math.min(Math.max(share, 0), 1));
      for (let axis = 0; axis < 3; axis++) colors[3 * i + axis] = table[at + axis];
    }
    attribute.needsUpdate = true;
  }

  // Root mean square error of the surface as read, mm.
  rmse() {
    return Math.sqrt(this.off.reduce((sum, x) => sum + x * x, 0) / (this.off.length / 3));
  }

  // Box around the body's movement from rest to `weights`.
  reach(weights) {
    const there = new Float32Array(this.rest.length);
    blend(there, this.rest, this.moved, weights);
    const box = new THREE.Box3().setFromArray(this.rest);
    return box.union(new THREE.Box3().setFromArray(there));
  }
}
