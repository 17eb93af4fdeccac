// The soft shadow of the body on the floor below it, rendered when its shape has changed.
import {
  Group,
  Mesh,
  MeshDepthMaterial,
  OrthographicCamera,
  PlaneGeometry,
  type Box3,
  type Object3D,
  type Scene,
  ShaderMaterial,
  Vector2,
  Vector3,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { ORDER } from "./order";

const TEXTURE_PX = 128; // enough for a blurred picture
const BLUR_PX = 3.5;
/** Margin around the body, as a share of its size, for the blur. */
const MARGIN = 0.25;

const UV_VERTEX = /* glsl */ `
  varying vec2 vUv;
  void main() { vUv = uv; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }
`;
const BLUR_FRAGMENT = /* glsl */ `
  uniform sampler2D image;
  uniform vec2 step;
  varying vec2 vUv;
  void main() {
    float sum = 0.0, total = 0.0;
    for (int i = -4; i <= 4; i++) {
      float weight = exp(-float(i * i) / 6.0);
      sum += weight * texture2D(image, vUv + step * float(i) / 4.0).a;
      total += weight;
    }
    gl_FragColor = vec4(0.0, 0.0, 0.0, sum / total);
  }
`;
const FLOOR_FRAGMENT = /* glsl */ `
  uniform sampler2D image;
  uniform float strength;
  varying vec2 vUv;
  void main() {
    float shadow = texture2D(image, vec2(vUv.x, 1.0 - vUv.y)).a;
    gl_FragColor = vec4(0.0, 0.0, 0.0, strength * shadow);
  }
`;

export class ContactShadow {
  readonly object = new Group();
  isStale = true;
  private readonly sharp = new WebGLRenderTarget(TEXTURE_PX, TEXTURE_PX);
  private readonly soft = new WebGLRenderTarget(TEXTURE_PX, TEXTURE_PX, { depthBuffer: false });
  private readonly camera = new OrthographicCamera();
  private readonly depth = new MeshDepthMaterial();
  private readonly blur = new ShaderMaterial({
    vertexShader: UV_VERTEX,
    fragmentShader: BLUR_FRAGMENT,
    uniforms: { image: { value: null }, step: { value: new Vector2() } },
    depthTest: false,
  });
  private readonly material = new ShaderMaterial({
    vertexShader: UV_VERTEX,
    fragmentShader: FLOOR_FRAGMENT,
    uniforms: { image: { value: this.sharp.texture }, strength: { value: 0.4 } },
    transparent: true,
    depthWrite: false,
  });
  private readonly floor = new Mesh(new PlaneGeometry(1, 1), this.material);
  private readonly quad = new Mesh(this.floor.geometry, this.blur);
  private readonly quadCamera = new OrthographicCamera(-0.5, 0.5, 0.5, -0.5, -1, 1);

  constructor() {
    this.floor.renderOrder = ORDER.shadow;
    this.object.add(this.floor);
    this.depth.onBeforeCompile = (shader) => {
      shader.fragmentShader = shader.fragmentShader.replace(
        "gl_FragColor = vec4( vec3( 1.0 - fragCoordZ ), opacity );",
        "gl_FragColor = vec4(0.0, 0.0, 0.0, pow(1.0 - fragCoordZ, 1.5));",
      );
    };
  }

  set strength(value: number) {
    this.material.uniforms.strength!.value = value;
  }

  /** Render the shadow of an object with a bounding box. */
  render(renderer: WebGLRenderer, scene: Scene, caster: Object3D, box: Box3): void {
    this.isStale = false;
    const size = box.getSize(new Vector3());
    const center = box.getCenter(new Vector3());
    const margin = MARGIN * Math.max(size.x, size.y);
    const [width, depth] = [size.x + 2 * margin, size.y + 2 * margin];
    this.floor.position.set(center.x, center.y, box.min.z - 0.01 * size.z);
    this.floor.scale.set(width, depth, 1);
    const { camera } = this;
    // Seen from below, so that y is reversed in the texture.
    camera.left = -width / 2;
    camera.right = width / 2;
    camera.top = depth / 2;
    camera.bottom = -depth / 2;
    camera.near = 0;
    camera.far = Math.max(size.z * 0.6, 1);
    camera.position.copy(this.floor.position);
    camera.rotation.set(Math.PI, 0, 0);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();

    const others = scene.children.filter((child) => child !== caster && child.visible);
    for (const other of others) other.visible = false;
    scene.overrideMaterial = this.depth;
    renderer.setRenderTarget(this.sharp);
    renderer.setClearColor(0x000000, 0);
    renderer.clear();
    renderer.render(scene, camera);
    scene.overrideMaterial = null;
    for (const other of others) other.visible = true;
    this.pass(renderer, this.sharp, this.soft, BLUR_PX / TEXTURE_PX, 0);
    this.pass(renderer, this.soft, this.sharp, 0, BLUR_PX / TEXTURE_PX);
    renderer.setRenderTarget(null);
  }

  dispose(): void {
    for (const target of [this.sharp, this.soft]) target.dispose();
    for (const material of [this.depth, this.blur, this.material]) material.dispose();
    this.floor.geometry.dispose();
  }

  private pass(
    renderer: WebGLRenderer,
    from: WebGLRenderTarget,
    to: WebGLRenderTarget,
    x: number,
    y: number,
  ): void {
    this.blur.uniforms.image!.value = from.texture;
    (this.blur.uniforms.step!.value as Vector2).set(x, y);
    renderer.setRenderTarget(to);
    renderer.clear();
    renderer.render(this.quad, this.quadCamera);
  }
}
