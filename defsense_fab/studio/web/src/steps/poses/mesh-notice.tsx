import { bodyFit, isJobActive } from "../../state/connection";
import { showToast } from "../../state/toasts";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { isMeshing, isMeshNeeded, isSimulated, makeMesh } from "./mesh";
import { posesState, shownPose } from "./state";

/** That the body is meshed, or a button that meshes it where that was canceled or has failed. */
export function MeshNotice() {
  if (!isMeshNeeded.value) return null;
  if (isMeshing.value) {
    // A shown pose says so in its line of status, so that its fields keep their places.
    return shownPose.value ? null : (
      <div class="notice" role="status">
        <span class="spinner" aria-hidden="true" />
        <p>The body is being meshed. Then it follows while you change poses.</p>
      </div>
    );
  }
  const isMissing = posesState.value?.mesh === "missing";
  const outside = bodyFit.value?.text;
  const text = isMissing
    ? "The body has no mesh yet. With one it follows while you change poses."
    : `The mesh belongs to an earlier body.${isSimulated.value ? " A new one replaces the last simulation." : ""}`;
  return (
    <div class="notice">
      <Icon name="info" />
      <p>{outside ? `${text} ${outside}.` : text}</p>
      <Button
        disabled={isJobActive.value}
        hint={isJobActive.value ? "Wait until the running job has ended" : "Make the mesh in the background"}
        onClick={() => makeMesh((problem) => showToast(problem, null, true))}
      >
        {isMissing ? "Mesh the body" : "Mesh it again"}
      </Button>
    </div>
  );
}
