// Starting builds; the parts need a decision on the cords first.
import { signal } from "@preact/signals";
import type { StartBuild } from "../protocol/messages";
import { connection } from "./connection";
import { attempt, showRefusal } from "./run";

type Stage = StartBuild["stage"];

/** Whether the question which cords are built is open. */
export const isAskingForCords = signal(false);

/** Start a build; ask first if it would move the drawn cords. Return whether it was accepted. */
export async function startBuild(
  stage: Stage,
  cords: StartBuild["cords"] = "ask",
): Promise<boolean> {
  const answer = await attempt(connection.send("start-build", { stage, cords }), (problem) => {
    if (problem.code === "cords-undecided") isAskingForCords.value = true;
    else showRefusal(problem);
  });
  return answer !== undefined;
}
