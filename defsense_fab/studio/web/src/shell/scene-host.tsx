// The place of the 3D scene.
export { SceneView as SceneHost } from "../scene/scene-view";
