// The stage: everything that is visible, its state (how far open, which pose, visible kinds), and how
// it is drawn.
class Stage {
  constructor(canvas, scene, redrawn) {
    this.content = scene.content;
    this.canvas = canvas;
    this.redrawn = redrawn;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.scene = new THREE.Scene();
    this.eye = new Eye(canvas, scene.content, () => this.draw());
    this.parts = scene.content.parts.map((part, k) => new Part(part, k, scene));
    this.followers = scene.content.followers.map((follower) => new Follower(follower, scene));
    this.body = new Body(scene);
    this.hidden = new Set();
    // Printed traces are inside a body that no joint opens.
    const through = scene.content.noun === "trace";
    this.state = { open: 0, pose: null, amount: 1, colors: "error", read: "hidden", through };
    this._light();
    for (const follower of [...this.parts, ...this.followers]) this.scene.add(follower.mesh);
    this.scene.add(this.body.mesh, this.body.read);
    this.resize();
    this.apply();
    this.eye.look("reset", this.box());
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  // Change the state and show it.
  set(changes) {
    Object.assign(this.state, changes);
    this.apply();
    const box = this.box();
    if (!box.equals(this.eye.box)) this.eye.follow(box);
    this.draw();
  }

  apply() {
    const { pose, open, amount, colors, read, through } = this.state;
    const posed = pose !== null;
    if (posed) {
      const weights = this.weights();
      this.body.pose(weights, colors);
      this.followers.forEach((follower) => follower.pose(weights));
    } else {
      const shares = this.shares(open);
      for (const follower of [...this.parts, ...this.followers]) follower.open(shares);
    }
    const bodyShown = !this.hidden.has("body");
    for (const part of this.parts) this._setVisible(part.mesh, !posed && bodyShown, through);
    this._setVisible(this.body.mesh, posed && bodyShown, through);
    this._setVisible(this.body.read, posed && read !== "hidden", false);
    this.body.read.material.wireframe = read === "over";
    const isOffset = posed && read === "next";
    this.body.read.position.copy(isOffset ? this._nextOffset() : new THREE.Vector3());
    for (const follower of this.followers) follower.mesh.visible = !this.hidden.has(follower.kind);
  }

  // How far each joint is open: the joint that is closed last opens first.
  shares(open) {
    const n = this.content.joints.length;
    return this.content.joints.map((_, k) => Math.min(Math.max(n * open - (n - 1 - k), 0), 1));
  }

  // Weights of all states, of the pose and amount shown.
  weights(amount = this.state.amount) {
    const pose = this.content.poses[this.state.pose];
    const weights = new Array(this.content.states.length).fill(0);
    weightsAt([0, ...pose.at], amount)
      .slice(1)
      .forEach((w, k) => (weights[pose.states[k]] = w));
    return weights;
  }

  // Resistance of each cord in the pose shown, ohm.
  resistances() {
    const weights = this.state.pose === null ? [] : this.weights();
    return this.content.resistances.map((rest, c) => {
      const change = weights.reduce((sum, w, k) => sum + w * this.content.states[k].signals[c], 0);
      return rest * (1 + change);
    });
  }

  // Box that the camera must show; for a pose, it holds the whole movement.
  box() {
    const box = new THREE.Box3();
    if (this.state.pose === null) {
      this.parts.forEach((part) => part.growBox(box));
      return box;
    }
    box.copy(this.body.reach(this.weights(1)));
    if (this.state.read === "next") box.union(box.clone().translate(this.body.read.position));
    return box;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.eye.resize(width, height);
    if (this.eye.box) this.draw();
  }

  // Draw once, with the next frame.
  draw() {
    if (this.frameRequest) return;
    this.frameRequest = requestAnimationFrame(() => {
      this.frameRequest = 0;
      this.renderer.render(this.scene, this.eye.camera);
      this.redrawn();
    });
  }

  // The part, cord, wire, pin or seat at a place of the page, or null.
  at(x, y) {
    const edge = this.canvas.getBoundingClientRect();
    const place = new THREE.Vector2((2 * (x - edge.left)) / edge.width - 1, 1 - (2 * (y - edge.top)) / edge.height);
    this.scene.updateMatrixWorld(); // the last change may not have been drawn yet
    const ray = new THREE.Raycaster();
    ray.setFromCamera(place, this.eye.camera);
    const all = [...this.followers, ...this.parts, this.body].filter((follower) => follower.mesh.visible);
    const hits = ray.intersectObjects(all.map((follower) => follower.mesh));
    const owner = (hit) => all.find((follower) => follower.mesh === hit.object);
    const inside = this.state.through && hits.find((hit) => owner(hit).kind === "cord");
    return hits.length ? owner(inside || hits[0]) : null;
  }

  mark(follower) {
    for (const each of [...this.parts, ...this.followers]) {
      each.mesh.material.emissive.set(each === follower ? "#5a5a5a" : "#000000");
    }
    this.draw();
  }

  _setVisible(mesh, visible, faint) {
    mesh.visible = visible;
    if (mesh.material.transparent === faint) return;
    mesh.material.transparent = faint;
    mesh.material.opacity = faint ? 0.3 : 1;
    mesh.material.depthWrite = !faint;
    mesh.renderOrder = faint ? 1 : 0;
    mesh.material.needsUpdate = true;
  }

  // Offset of the surface as read: below a wide body, to the right of a tall one.
  _nextOffset() {
    const size = this.body.reach(this.weights(1)).getSize(new THREE.Vector3());
    const { up, right } = this.eye, gap = 0.05 * this.content.size;
    const along = (way) => ["x", "y", "z"].reduce((sum, axis) => sum + size[axis] * Math.abs(way[axis]), 0);
    const tall = along(up), wide = along(right);
    if (wide <= tall) return right.clone().multiplyScalar(1.05 * wide + gap);
    return up.clone().multiplyScalar(-1.05 * tall - gap);
  }

  _light() {
    const lamp = new THREE.DirectionalLight("#ffffff", 1.9);
    lamp.position.set(-0.5, 0.8, 1); // next to the camera
    this.eye.camera.add(lamp);
    this.scene.add(this.eye.camera, new THREE.AmbientLight("#ffffff", 1.5));
  }
}
