import type { Problem } from "../protocol/messages";
import { remedyOf } from "../state/remedies";
import { Button } from "../ui/button";

/** The button that cures a problem; none if nothing does. */
export function RemedyButton({ problem }: { problem: Problem }) {
  const remedy = remedyOf(problem);
  return remedy && <Button onClick={remedy.run}>{remedy.label}</Button>;
}
