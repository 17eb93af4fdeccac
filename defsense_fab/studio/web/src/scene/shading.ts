// Materials of bodies and cords: one soft light, computed from the normal alone.
import {
  AlwaysStencilFunc,
  BackSide,
  Color,
  EqualStencilFunc,
  FrontSide,
  ReplaceStencilOp,
  ShaderMaterial,
  type Texture,
  Vector2,
} from "three";
import { roundLength } from "./scale-bar";

/** Stencil value of the pixels where the body hides what is behind it. */
const BODY_STENCIL = 1;

// The sky is above in the world, the key light stays at the viewer's left shoulder.
export const LIGHT = /* glsl */ `
  const vec3 KEY = vec3(-0.36, 0.52, 0.775);
  vec3 lit(vec3 base, vec3 normal) {
    float up = dot(normal, viewMatrix[2].xyz);
    float light = mix(0.50, 0.74, 0.5 + 0.5 * up) + 0.42 * max(0.0, dot(normal, KEY));
    float rim = 1.0 - abs(normal.z);
    return base * light * (1.0 - 0.4 * rim * rim * rim * rim);
  }
`;

/** Cells of the lines on a body, at least, along its diagonal. */
const SMALLEST_CELL_COUNT = 8;
/** Darkness of the lines. */
const GRID_STRENGTH = 0.3;

const BODY_VERTEX = /* glsl */ `
  varying vec3 vNormal;
  varying vec3 vColor;
  uniform vec3 base;
  #ifdef HAS_GRID
    attribute vec3 rest;
    varying vec3 vRest;
  #endif
  void main() {
    vNormal = normalMatrix * normal;
    #ifdef HAS_GRID
      vRest = rest;
    #endif
    #ifdef USE_COLOR
      vColor = color;
    #else
      vColor = base;
    #endif
    // In the order of three's own materials, so that a pass for the depth has equal values.
    gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
  }
`;

const BODY_FRAGMENT = /* glsl */ `
  varying vec3 vNormal;
  varying vec3 vColor;
  uniform float opacity;
  uniform bool isExact;
  ${LIGHT}
  #ifdef HAS_GRID
    uniform float grid;
    varying vec3 vRest;
    // Lines in planes of the body at rest, a pixel wide; none on faces along such a plane.
    float gridLine() {
      vec3 across = abs(normalize(cross(dFdx(vRest), dFdy(vRest))));
      vec3 pixels = max(fwidth(vRest), 1e-6);
      vec3 distance = abs(fract(vRest / grid - 0.5) - 0.5) * grid / pixels;
      vec3 line = (1.0 - smoothstep(0.5, 1.5, distance)) * (1.0 - smoothstep(0.75, 0.95, across))
        * (1.0 - smoothstep(0.1, 0.35, pixels / grid));
      return max(line.x, max(line.y, line.z));
    }
  #endif
  void main() {
    vec3 color = isExact ? vColor : lit(vColor, normalize(vNormal));
    float alpha = opacity;
    #ifdef HAS_ONLY_GRID
      alpha *= gridLine();
      color = vColor;
    #elif defined(HAS_GRID)
      color *= 1.0 - ${GRID_STRENGTH} * gridLine();
    #endif
    gl_FragColor = vec4(color, alpha);
    #include <colorspace_fragment>
  }
`;

/** Return the material of a body; it marks in the stencil where it hides cords. */
export function bodyMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    defines: {},
    vertexShader: BODY_VERTEX,
    fragmentShader: BODY_FRAGMENT,
    uniforms: {
      base: { value: new Color() },
      opacity: { value: 1 },
      isExact: { value: false },
      grid: { value: 1 },
    },
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
    stencilWrite: true,
    stencilRef: BODY_STENCIL,
    stencilFunc: AlwaysStencilFunc,
    stencilZPass: ReplaceStencilOp,
  });
}

/**
 * Draw lines on a body that move with it, so that turning a round body is seen.
 *
 * @param spacing - Their distance in the body at rest, mm; 0 for none. Where it is not 0, the
 * geometry has an attribute `rest` with the places of the vertices at rest.
 */
export function setGrid(material: ShaderMaterial, spacing: number): void {
  if (spacing) material.uniforms["grid"]!.value = spacing;
  if ("HAS_GRID" in material.defines === spacing > 0) return;
  if (spacing) material.defines["HAS_GRID"] = "";
  else delete material.defines["HAS_GRID"];
  material.needsUpdate = true;
}

/** Return a distance of the lines for a body with a diagonal, mm. */
export function gridSpacing(diagonal: number): number {
  return roundLength(diagonal / SMALLEST_CELL_COUNT);
}

const TUBE_VERTEX = /* glsl */ `
  attribute float along;
  attribute float broken;
  uniform float outline;
  uniform bool isLifted;
  uniform vec2 viewport;
  varying vec3 vNormal;
  varying float vAlong;
  varying float vBroken;
  void main() {
    vNormal = normalMatrix * normal;
    vAlong = along;
    vBroken = broken;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    vec2 away = normalize((projectionMatrix * vec4(vNormal, 0.0)).xy + 1e-9);
    gl_Position.xy += away * outline * 2.0 / viewport * gl_Position.w;
    // In front of all bodies, in the same order among themselves.
    if (isLifted) gl_Position.z = 0.02 * gl_Position.z - 0.98 * gl_Position.w;
  }
`;

const TUBE_FRAGMENT = /* glsl */ `
  uniform vec3 base;
  uniform vec3 alarm;
  uniform float opacity;
  uniform bool isExact;
  uniform float stripe;
  varying vec3 vNormal;
  varying float vAlong;
  varying float vBroken;
  ${LIGHT}
  void main() {
    vec3 color = base;
    if (vBroken > 0.5) color = fract(vAlong / stripe) < 0.5 ? alarm : vec3(1.0);
    gl_FragColor = vec4(isExact ? color : lit(color, normalize(vNormal)), opacity);
    #include <colorspace_fragment>
  }
`;

export type TubePass = "visible" | "hidden" | "outline";

/** Return the material of a cord where it is visible, where the body hides it, or its outline. */
export function tubeMaterial(pass: TubePass): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: TUBE_VERTEX,
    fragmentShader: TUBE_FRAGMENT,
    uniforms: {
      base: { value: new Color() },
      alarm: { value: new Color() },
      opacity: { value: 1 },
      isExact: { value: pass === "outline" },
      stripe: { value: 3 },
      outline: { value: 0 },
      isLifted: { value: pass !== "visible" },
      viewport: { value: new Vector2(1, 1) },
    },
    side: pass === "outline" ? BackSide : FrontSide,
    transparent: pass !== "visible",
    stencilWrite: pass === "hidden",
    stencilRef: BODY_STENCIL,
    stencilFunc: pass === "hidden" ? EqualStencilFunc : AlwaysStencilFunc,
  });
}

/** Return the material of a rectangle over the whole view that shows a rendered picture. */
export function pictureMaterial(picture: Texture): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: /* glsl */ `
      varying vec2 vUv;
      void main() { vUv = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }
    `,
    fragmentShader: /* glsl */ `
      uniform sampler2D picture;
      varying vec2 vUv;
      void main() {
        vec4 color = texture2D(picture, vUv);
        // The colors are multiplied by their opacity.
        gl_FragColor = vec4(color.rgb / max(color.a, 1e-3), color.a);
        #include <colorspace_fragment>
      }
    `,
    uniforms: { picture: { value: picture } },
    transparent: true,
    depthTest: false,
    depthWrite: false,
  });
}

/** Return the material of the background, a gradient from above to below. */
export function backgroundMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: /* glsl */ `
      uniform vec3 sky;
      uniform vec3 ground;
      varying vec3 vColor;
      void main() {
        vColor = mix(ground, sky, 0.5 + 0.5 * position.y);
        gl_Position = vec4(position.xy, 1.0, 1.0);
      }
    `,
    fragmentShader: /* glsl */ `
      varying vec3 vColor;
      void main() { gl_FragColor = vec4(vColor, 1.0); }
    `,
    uniforms: { sky: { value: new Color() }, ground: { value: new Color() } },
    depthTest: false,
    depthWrite: false,
  });
}
