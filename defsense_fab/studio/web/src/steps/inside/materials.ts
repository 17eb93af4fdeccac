// Materials of a cut body: its skin behind the plane, its edges, and the colored section.
import { Color, DataTexture, DoubleSide, LinearFilter, ShaderMaterial, Vector3 } from "three";
import { LIGHT } from "../../scene/shading";
import { type ColorScale, TABLE_SIZE } from "./color-scale";

/** Uniforms of the plane, which all materials of a body share. */
export interface PlaneUniforms {
  planeOrigin: { value: Vector3 };
  planeNormal: { value: Vector3 };
}

export function planeUniforms(): PlaneUniforms {
  return { planeOrigin: { value: new Vector3() }, planeNormal: { value: new Vector3(0, 0, 1) } };
}

// The plane is one of the body at rest, so that the cut bends with the body.
const HEIGHT = /* glsl */ `
  uniform vec3 planeOrigin;
  uniform vec3 planeNormal;
  varying vec3 vRest;
  float heightAbovePlane() {
    return dot(vRest - planeOrigin, planeNormal);
  }
`;

/** The skin behind the plane; its inside has one color, so that the cut looks closed. */
export function skinMaterial(plane: PlaneUniforms): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: /* glsl */ `
      attribute vec3 rest;
      varying vec3 vRest;
      varying vec3 vNormal;
      void main() {
        vRest = rest;
        vNormal = normalMatrix * normal;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }
    `,
    fragmentShader: /* glsl */ `
      ${HEIGHT}
      uniform vec3 base;
      uniform vec3 cap;
      varying vec3 vNormal;
      ${LIGHT}
      void main() {
        if (heightAbovePlane() > 0.0) discard;
        gl_FragColor = vec4(gl_FrontFacing ? lit(base, normalize(vNormal)) : cap, 1.0);
        #include <colorspace_fragment>
      }
    `,
    uniforms: { ...plane, base: { value: new Color() }, cap: { value: new Color() } },
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 2,
    polygonOffsetUnits: 8,
  });
}

/** The edges: clear behind the plane, and faint where the body is cut away. */
export function edgeMaterial(plane: PlaneUniforms): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: /* glsl */ `
      attribute vec3 rest;
      varying vec3 vRest;
      void main() {
        vRest = rest;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }
    `,
    fragmentShader: /* glsl */ `
      ${HEIGHT}
      uniform vec3 base;
      void main() {
        gl_FragColor = vec4(base, heightAbovePlane() > 0.0 ? 0.16 : 0.7);
        #include <colorspace_fragment>
      }
    `,
    uniforms: { ...plane, base: { value: new Color() } },
    transparent: true,
    depthWrite: false,
  });
}

/** A section in the exact colors of a scale, without light. */
export function sectionMaterial(plane: PlaneUniforms): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: /* glsl */ `
      attribute vec3 rest;
      attribute float value;
      attribute float known;
      varying vec3 vRest;
      varying float vValue;
      varying float vKnown;
      void main() {
        vRest = rest;
        vValue = value;
        vKnown = known;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }
    `,
    fragmentShader: /* glsl */ `
      ${HEIGHT}
      uniform sampler2D table;
      uniform float start;
      uniform float end;
      uniform float reach;
      uniform vec3 unknown;
      varying float vValue;
      varying float vKnown;
      void main() {
        // A section that the plane has left behind is not part of the body any more.
        if (heightAbovePlane() > reach) discard;
        float share = clamp((vValue - start) / (end - start), 0.0, 1.0);
        float place = (share * ${TABLE_SIZE - 1}.0 + 0.5) / ${TABLE_SIZE}.0;
        vec3 color = texture2D(table, vec2(place, 0.5)).rgb;
        gl_FragColor = vec4(vKnown < 0.999 ? unknown : color, 1.0);
      }
    `,
    uniforms: {
      ...plane,
      table: { value: null },
      start: { value: 0 },
      end: { value: 1 },
      reach: { value: 1 },
      unknown: { value: new Vector3(0.6, 0.6, 0.6) },
    },
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 4,
  });
}

/** Show the colors of a scale, which are sRGB as the screen shows them. */
export function setScale(material: ShaderMaterial, scale: ColorScale): void {
  const { table, start, end } = material.uniforms;
  const texture = table!.value as DataTexture | null;
  if (texture?.image.data !== scale.table) {
    texture?.dispose();
    table!.value = tableTexture(scale.table);
  }
  start!.value = scale.start;
  end!.value = scale.end;
}

function tableTexture(table: Uint8Array): DataTexture {
  const texture = new DataTexture(table, TABLE_SIZE, 1);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}
