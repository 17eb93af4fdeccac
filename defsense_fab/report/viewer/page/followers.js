// What is seen: the parts, what goes with them, and the body's simulated surface.
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

// A part's colour, so pale that the cords' stand out from it.
function paler(color) {
  return "#" + new THREE.Color(color).lerp(new THREE.Color("#ffffff"), 0.12).getHexString();
}

class Part {
  constructor(told, k, scene) {
    const points = pointsOf(scene.arrays[told.places], scene.told.step);
    this.kind = "part";
    this.told = told;
    this.mesh = meshOf(points, facesOf(scene.arrays[told.faces]), solidOf(paler(told.color)));
    this.mesh.geometry.computeBoundingBox();
    this.ways = scene.told.joints.map((joint) => new THREE.Vector3(...joint.ways[k]));
  }

  // Moved as far as each joint is open, from 0 to 1.
  open(shares) {
    this.mesh.position.set(0, 0, 0);
    shares.forEach((share, k) => this.mesh.position.addScaledVector(this.ways[k], share));
  }

  growBox(box) {
    const own = this.mesh.geometry.boundingBox.clone().translate(this.mesh.position);
    box.union(own);
  }
}

// A cord, wire, pin or marker seat.
class Follower {
  constructor(told, scene) {
    const { arrays } = scene, { step, joints, states } = scene.told;
    const sheets = (place, count) =>
      Array.from({ length: count }, (_, k) => pointsOf(arrays[place], step, count, k));
    this.kind = told.kind;
    this.told = told;
    this.rest = pointsOf(arrays[told.places], step);
    this.opened = sheets(told.opened, joints.length);
    this.moved = sheets(told.moved, states.length);
    this.now = this.rest.slice();
    const color = told.color || KIND_COLORS[told.kind];
    this.mesh = told.radius
      ? new THREE.Mesh(tubeGeometry(this.rest.length / 3), new THREE.MeshLambertMaterial({ color }))
      : meshOf(new Float32Array(12), new Uint32Array([0, 1, 2, 0, 2, 3]),
          solidOf(color, { side: THREE.DoubleSide }));
    this.size = scene.told.size;
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

  // A seat is lifted by so many mm above its flat, to be seen.
  _show(lift) {
    const { geometry } = this.mesh;
    if (this.told.radius) return layTube(geometry, this.now, this.told.radius);
    const [a, b, c] = [0, 3, 6].map((k) => new THREE.Vector3().fromArray(this.now, k));
    const out = b.clone().sub(a).cross(c.sub(b)).setLength(lift);
    const position = geometry.getAttribute("position");
    for (let k = 0; k < this.now.length; k++) position.array[k] = this.now[k] + out.getComponent(k % 3);
    geometry.getAttribute("position").needsUpdate = true;
    geometry.computeBoundingSphere();
    geometry.computeBoundingBox();
  }
}

// The surface that was simulated, in a pose; beside or over it that which is read.
class Body {
  constructor(scene) {
    const { arrays } = scene, { step, states, surface } = scene.told;
    const sheets = (place, by) =>
      states.map((_, k) => pointsOf(arrays[place], by, states.length, k));
    const faces = facesOf(arrays[surface.faces]);
    this.kind = "surface";
    this.told = { name: "body", facts: [["simulated surface", faces.length / 3 + " triangles"]] };
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

  // Root mean square of how far the read shape is off, mm.
  rmse() {
    return Math.sqrt(this.off.reduce((sum, x) => sum + x * x, 0) / (this.off.length / 3));
  }

  // The box around all that the body passes through on the way from rest to `weights`.
  reach(weights) {
    const there = new Float32Array(this.rest.length);
    blend(there, this.rest, this.moved, weights);
    const box = new THREE.Box3().setFromArray(this.rest);
    return box.union(new THREE.Box3().setFromArray(there));
  }
}
