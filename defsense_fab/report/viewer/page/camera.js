// The camera: its place, its field of view, and how mouse, touch and keys move it.
const LENS = 30; // degrees
const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

class Eye {
  constructor(canvas, content, changed) {
    this.camera = new THREE.PerspectiveCamera(LENS, 1, content.size / 100, content.size * 100);
    const [right, up, front] = content.frame.map((way) => new THREE.Vector3(...way).normalize());
    this.right = right;
    this.up = up;
    this.camera.up.copy(this.up);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.minDistance = 0.05 * content.size;
    this.controls.maxDistance = 50 * content.size;
    this.controls.enableZoom = false; // the wheel scrolls the page until the view is clicked
    this.controls.addEventListener("change", changed);
    canvas.addEventListener("pointerdown", () => canvas.focus({ preventScroll: true }));
    canvas.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "touch") this.controls.enableZoom = true;
    });
    canvas.addEventListener("pointerdown", () => (canvas.nextElementSibling.hidden = true), { once: true });
    canvas.addEventListener("focus", () => (this.controls.enableZoom = true));
    canvas.addEventListener("blur", () => (this.controls.enableZoom = false));
    this.changed = changed;
    const top = up.clone().addScaledVector(front, 1e-3);
    const reset = front.clone().addScaledVector(right, 0.35).addScaledVector(up, 0.55);
    this.ways = { reset, front, side: right, top };
  }

  resize(width, height) {
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
  }

  // Distance from the middle of a box at which the camera shows all of it, along a direction.
  distance(box, way) {
    const back = way.clone().normalize();
    const right = new THREE.Vector3().crossVectors(this.up, back).normalize();
    const over = new THREE.Vector3().crossVectors(back, right);
    const tall = Math.tan((LENS * Math.PI) / 360);
    const wide = tall * this.camera.aspect;
    const middle = box.getCenter(new THREE.Vector3());
    let far = 0;
    for (let k = 0; k < 8; k++) {
      const corner = new THREE.Vector3(
        box[k & 1 ? "max" : "min"].x, box[k & 2 ? "max" : "min"].y, box[k & 4 ? "max" : "min"].z,
      ).sub(middle);
      const reach = Math.max(Math.abs(corner.dot(right)) / wide, Math.abs(corner.dot(over)) / tall);
      far = Math.max(far, reach + corner.dot(back));
    }
    return 1.08 * far;
  }

  look(name, box) {
    const way = this.ways[name];
    const target = box.getCenter(new THREE.Vector3());
    this._fly(target, way.clone().setLength(this.distance(box, way)));
    this.box = box.clone();
  }

  // Keep the share of the picture that the content fills when its size changes.
  follow(box) {
    const way = this.camera.position.clone().sub(this.controls.target);
    const grown = this.distance(box, way) / this.distance(this.box, way);
    const middles = [this.box, box].map((b) => b.getCenter(new THREE.Vector3()));
    this.controls.target.add(middles[1].sub(middles[0]));
    this.camera.position.copy(this.controls.target).addScaledVector(way, grown);
    this.box = box.clone();
    this.controls.update();
  }

  turn(right, up) {
    const target = this.controls.target;
    const way = this.camera.position.clone().sub(target).applyAxisAngle(this.up, right);
    const axis = new THREE.Vector3().crossVectors(this.up, way).normalize();
    const tilted = way.clone().applyAxisAngle(axis, -up);
    const angle = tilted.angleTo(this.up);
    this.camera.position.copy(target).add(angle > 0.02 && angle < Math.PI - 0.02 ? tilted : way);
    this.controls.update();
  }

  nearer(factor) {
    const target = this.controls.target;
    const way = this.camera.position.clone().sub(target);
    this.camera.position.copy(target).addScaledVector(way, 1 / factor);
    this.controls.update();
  }

  _fly(target, way) {
    cancelAnimationFrame(this.flight);
    const from = this.controls.target.clone();
    const startedAt = this.camera.position.clone().sub(from);
    const place = (share) => {
      this.controls.target.lerpVectors(from, target, share);
      const length = startedAt.length() * (1 - share) + way.length() * share;
      const now = startedAt.clone().normalize().lerp(way.clone().normalize(), share);
      if (now.lengthSq() < 1e-6) now.copy(way);
      this.camera.position.copy(this.controls.target).add(now.setLength(length));
      this.controls.update();
      this.changed();
    };
    if (calm.matches || !this.box || startedAt.lengthSq() === 0) return place(1);
    const start = performance.now();
    const frame = (now) => {
      const t = Math.min(Math.max((now - start) / 350, 0), 1);
      place(t * t * (3 - 2 * t));
      if (t < 1) this.flight = requestAnimationFrame(frame);
    };
    this.flight = requestAnimationFrame(frame);
  }
}
