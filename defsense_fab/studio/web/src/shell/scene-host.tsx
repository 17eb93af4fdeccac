/** The place of the 3D scene. */
export function SceneHost() {
  return <div class="scene-host" />;
}
